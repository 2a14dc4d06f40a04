"""Windows of a log that are left out as if the robot had been switched off: it wakes up elsewhere, and nothing tells it.

Odometry and counters go on after a window where they stood before it; speeds are zero in between.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from pfcli.errors import UsageError
from pfcli.events import Event, Odometry, Pose2, Steering, Ticks, Twist, Wheels, YawRate

_SECOND = 1_000_000_000
Window = tuple[float, float]
"""From and to, in seconds after the log's first stamp."""


def parse(texts: Sequence[str]) -> tuple[Window, ...]:
    """Windows of `--cut A,B` flags, in their order. Raises UsageError."""
    found = []
    for text in texts:
        try:
            begin, end = (float(word) for word in text.split(","))
        except ValueError:
            raise UsageError(f"--cut {text}: expected FROM,TO in seconds after the log's first stamp") from None
        if not 0 <= begin < end < math.inf:
            raise UsageError(f"--cut {text}: expected FROM,TO with 0 <= FROM < TO")
        found.append((begin, end))
    return tuple(sorted(found))


def without(events: Iterable[Event], windows: Sequence[Window], first_ns: Callable[[], int]) -> Iterator[Event]:
    """The events outside of the windows; `first_ns` tells the log's first stamp once there is an event."""
    asleep, before = False, dict[type, Event]()
    odometry, counted = Pose2(), dict[str, Any]()
    woken = set[type]()
    for event in events:
        after_s = (event.stamp_ns - first_ns()) / _SECOND
        if any(begin <= after_s < end for begin, end in windows):
            asleep = True
            continue
        if asleep:
            asleep, woken = False, set(before)
        kind = type(event)
        if kind in woken:
            woken.discard(kind)
            last = before[kind]
            if isinstance(event, Odometry) and isinstance(last, Odometry):
                odometry = _offset(last, event)
            elif isinstance(event, Wheels) and isinstance(last, Wheels) and event.names == last.names:
                counted["wheels"] = last.position_rad - event.position_rad
            elif (
                isinstance(event, Ticks) and isinstance(last, Ticks) and event.names == last.names and event.cumulative
            ):
                counted["ticks"] = last.ticks - event.ticks
            elif isinstance(event, Twist | Steering | YawRate):
                yield _at_rest(last, last.stamp_ns + 1)
                yield _at_rest(event, event.stamp_ns - 1)
        shown = _moved(event, odometry, counted)
        before[kind] = shown
        yield shown


def _moved(event: Event, odometry: Pose2, counted: dict[str, Any]) -> Event:
    """An event with its counters as they would be had nothing moved in the windows."""
    if isinstance(event, Odometry):
        x, y, yaw = odometry
        if (x, y, yaw) == (0.0, 0.0, 0.0):
            return event
        c, s = math.cos(yaw), math.sin(yaw)
        return event._replace(
            x_m=x + c * event.x_m - s * event.y_m,
            y_m=y + s * event.x_m + c * event.y_m,
            yaw_rad=math.remainder(yaw + event.yaw_rad, 2 * math.pi),
        )
    if isinstance(event, Wheels) and "wheels" in counted:
        return event._replace(position_rad=event.position_rad + counted["wheels"])
    if isinstance(event, Ticks) and "ticks" in counted and event.cumulative:
        return event._replace(ticks=event.ticks + counted["ticks"])
    return event


def _offset(last: Odometry, now: Odometry) -> Pose2:
    """What brings a pose of the odometry to the one before the window: `last` composed with the inverse of `now`."""
    turn = math.remainder(last.yaw_rad - now.yaw_rad, 2 * math.pi)
    c, s = math.cos(turn), math.sin(turn)
    return Pose2(last.x_m - c * now.x_m + s * now.y_m, last.y_m - s * now.x_m - c * now.y_m, turn)


def _at_rest(event: Event, stamp_ns: int) -> Event:
    """A reading of speed at which the robot stands."""
    if isinstance(event, Twist):
        return Twist(stamp_ns, 0.0, 0.0, 0.0)
    if isinstance(event, Steering):
        return event._replace(stamp_ns=stamp_ns, speed_mps=0.0)
    assert isinstance(event, YawRate)
    return event._replace(stamp_ns=stamp_ns, yaw_rate_radps=0.0)
