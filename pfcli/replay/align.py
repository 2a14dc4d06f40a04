"""From motion events of any kind to one odometry pose at each scan's own stamp."""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.dropped import Dropped
from pfcli.events import (
    Event,
    Heading,
    Landmarks,
    LinePoints,
    Odometry,
    Range,
    Ranges,
    Rolling,
    Scan,
    Sighting,
    Sounding,
    SourceStamp,
    Sweep,
)
from pfcli.replay.dead_reckoning import SECOND, DeadReckoning
from pfcli.replay.settings import Drive

ROLES = {
    "odometry": ("odometry",),
    "odometry-twist": ("odometry",),
    "encoders": ("encoders",),
    "twist": ("twist",),
    "imu": ("imu",),
}


def rounds(events: Iterable[Event]) -> Iterator[Event]:
    """The readings of single range finders put together: a round ends when all that were ever heard have reported, or
    when one reports again. Other events pass."""
    heard: list[str] = []
    now: dict[str, Range] = {}
    for event in events:
        if not isinstance(event, Range):
            yield event
            continue
        if event.topic in now:
            yield _round([now[topic] for topic in heard if topic in now])
            now = {}
        if event.topic not in heard:
            heard.append(event.topic)
            heard.sort()
        now[event.topic] = event
        if len(now) == len(heard) > 1:
            yield _round([now[topic] for topic in heard])
            now = {}
    if now:
        yield _round([now[topic] for topic in heard if topic in now])


def _round(readings: list[Range]) -> Ranges:
    return Ranges(
        max(r.stamp_ns for r in readings),
        np.array([r.range_m for r in readings], np.float32),
        np.array([r.mount for r in readings], np.float64),
        np.array([r.range_min_m for r in readings], np.float32),
        np.array([r.range_max_m for r in readings], np.float32),
    )


def sightings(events: Iterable[Event]) -> Iterator[Event]:
    """What vision saw at one stamp put together: line points and landmarks. Other events pass."""
    now: Sighting | None = None
    for event in events:
        seen = _sighting(event)
        if now is not None and (seen is None or seen.stamp_ns != now.stamp_ns):
            yield now
            now = None
        if seen is None:
            yield event
        elif now is None:
            now = seen
        else:
            now = now._replace(
                points_m=np.concatenate([now.points_m, seen.points_m]), landmarks=now.landmarks + seen.landmarks
            )
    if now is not None:
        yield now


def _sighting(event: Event) -> Sighting | None:
    if isinstance(event, LinePoints):
        return Sighting(event.stamp_ns, (0.0, 0.0, 0.0), event.points_m, ())
    if isinstance(event, Landmarks):
        return Sighting(event.stamp_ns, (0.0, 0.0, 0.0), np.empty((0, 2)), (event,))
    return None


class _Instant(NamedTuple):
    """Odometry at a stamp, and how far each wheel has rolled and the robot has gone and turned till then."""

    odometry: Odometry
    rolled: NDArray[np.float64]
    travelled: tuple[float, float]


def sweeps(
    events: Iterable[Event], source: str, drive: Drive, dropped: Dropped, max_gap_s: float = 1.0
) -> Iterator[Sweep | Sounding | Sighting]:
    """Scans (rounds of the range finders, sightings) with the odometry pose of their own stamp, interpolated between the
    motion events around it.

    A reading before the first or more than `max_gap_s` after the last motion event is counted in `dropped`.
    """
    reckon = DeadReckoning(source, drive, dropped)
    before: _Instant | None = None
    text = SourceStamp(-1, "")
    compass = _Compass()
    waiting: deque[tuple[Scan | Ranges | Sighting, str]] = deque()
    for event in sightings(rounds(events)):
        if isinstance(event, Scan | Ranges | Sighting):
            name = text.text if text.stamp_ns == event.stamp_ns else ""
            if isinstance(event, Sighting):
                event = compass.at(event)
            if before is not None and before.odometry.stamp_ns == event.stamp_ns:
                yield _joined(event, before, name, reckon)
            else:
                waiting.append((event, name))
            continue
        if isinstance(event, SourceStamp):
            text = event
            continue
        if isinstance(event, Heading):
            compass.hear(event)
            continue
        odometry = reckon(event)
        if odometry is None:
            continue
        after = _Instant(odometry, reckon.rolled, _travelled(before, odometry))
        while waiting and waiting[0][0].stamp_ns <= odometry.stamp_ns:
            reading, name = waiting.popleft()
            if before is None and reading.stamp_ns < odometry.stamp_ns:
                what = "sighting" if isinstance(reading, Sighting) else "scan"
                dropped.add(
                    f"{what} before odometry", f"{what}s before the first message of the motion source have no pose"
                )
                continue
            start = before if before is not None else after
            gap_s = (odometry.stamp_ns - start.odometry.stamp_ns) / SECOND
            if gap_s > max_gap_s:
                dropped.add("gap in odometry", f"odometry pauses for {gap_s:.1f} s; poses there are interpolated")
            yield _joined(reading, _between(start, after, reading.stamp_ns), name, reckon)
        before = after
    for reading, name in waiting:
        if before is not None and reading.stamp_ns - before.odometry.stamp_ns <= max_gap_s * SECOND:
            yield _joined(reading, before, name, reckon)
        else:
            what = "sighting" if isinstance(reading, Sighting) else "scan"
            dropped.add(f"{what} without odometry", f"{what}s after the last message of the motion source have no pose")


class _Compass:
    """The newest reading of the compass, for the sighting that comes next; an old one says nothing."""

    _OLD_NS = SECOND // 2

    def __init__(self) -> None:
        self._last: Heading | None = None

    def hear(self, heading: Heading) -> None:
        self._last = heading

    def at(self, sighting: Sighting) -> Sighting:
        """The sighting with the compass reading that no sighting had yet."""
        last, self._last = self._last, None
        if last is None or sighting.stamp_ns - last.stamp_ns > self._OLD_NS:
            return sighting
        return sighting._replace(compass=last)


def bare(events: Iterable[Event]) -> Iterator[Sweep]:
    """Scans alone, as if the robot stood still."""
    return (Sweep(event.stamp_ns, (0.0, 0.0, 0.0), event, "") for event in events if isinstance(event, Scan))


def _joined(
    reading: Scan | Ranges | Sighting, at: _Instant, name: str, reckon: DeadReckoning
) -> Sweep | Sounding | Sighting:
    odometry = at.odometry[1:4]
    if isinstance(reading, Sighting):
        rolling = None if reckon.jacobian is None else Rolling(at.rolled, reckon.jacobian, reckon.back)
        return reading._replace(odometry=odometry, rolling=rolling, travelled=at.travelled, source_stamp=name)
    if isinstance(reading, Ranges):
        return Sounding(reading.stamp_ns, odometry, reading, name)
    return Sweep(reading.stamp_ns, odometry, reading, name)


def _travelled(before: _Instant | None, now: Odometry) -> tuple[float, float]:
    """Way and turn up to now, without signs."""
    if before is None:
        return 0.0, 0.0
    last, (way, turn) = before.odometry, before.travelled
    step = math.hypot(now.x_m - last.x_m, now.y_m - last.y_m)
    return way + step, turn + abs(math.remainder(now.yaw_rad - last.yaw_rad, 2 * math.pi))


def _between(a: _Instant, b: _Instant, stamp_ns: int) -> _Instant:
    """Linear in between; the heading goes the short way round."""
    p, q = a.odometry, b.odometry
    if q.stamp_ns == p.stamp_ns:
        return b
    s = (stamp_ns - p.stamp_ns) / (q.stamp_ns - p.stamp_ns)
    turn = math.remainder(q.yaw_rad - p.yaw_rad, 2 * math.pi)
    yaw = math.remainder(p.yaw_rad + s * turn, 2 * math.pi)
    odometry = Odometry(stamp_ns, p.x_m + s * (q.x_m - p.x_m), p.y_m + s * (q.y_m - p.y_m), yaw)
    travelled = (
        a.travelled[0] + s * (b.travelled[0] - a.travelled[0]),
        a.travelled[1] + s * (b.travelled[1] - a.travelled[1]),
    )
    return _Instant(odometry, a.rolled + s * (b.rolled - a.rolled) if a.rolled.size else b.rolled, travelled)
