"""From motion events of any kind to one odometry pose at each scan's own stamp."""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from pfcli.errors import UsageError
from pfcli.events import (
    Event,
    Odometry,
    Range,
    Ranges,
    Scan,
    Sounding,
    SourceStamp,
    Sweep,
    Ticks,
    Twist,
    Wheels,
    YawRate,
)
from pfcli.replay import Loss

SECOND = 1_000_000_000
SOURCES = ("auto", "odometry", "odometry-twist", "encoders", "twist", "imu")
"""Where motion comes from; imu: yaw rate of the gyroscope with the speed of wheels, twist or odometry."""

ROLES = {
    "odometry": ("odometry",),
    "odometry-twist": ("odometry",),
    "encoders": ("encoders",),
    "twist": ("twist",),
    "imu": ("imu",),
}

_FASTEST_MPS, _SHORTEST_S = 30.0, 0.1
"""No wheel of a robot runs faster; stamps of one burst may be nearer to each other than the motion they report."""


class Drive(NamedTuple):
    """A differential drive: the joints of the left and right wheel, their radii and the track width (m)."""

    joints: tuple[str, str] | None = None
    radius_left_m: float = 0.0
    radius_right_m: float = 0.0
    track_m: float = 0.0


class DeadReckoning:
    """Turns motion events into odometry poses (Zhang 2014, eqs (2)-(4)); ticks may wrap at 32 bits, and a jump of theirs
    that no robot can drive is counted in `loss` and left out."""

    def __init__(self, source: str, drive: Drive, loss: Loss | None = None) -> None:
        self._loss = Loss() if loss is None else loss
        self._source = source
        self._drive = drive
        self._pose = (0.0, 0.0, 0.0)
        self._last_ns: int | None = None
        self._last_speed = (0.0, 0.0, 0.0)
        self._wheels: tuple[float, float] | None = None
        self._yaw_rate = 0.0
        self._speed = 0.0

    def __call__(self, event: Event) -> Odometry | None:
        """The odometry pose after this event, or None where it says nothing about motion yet."""
        if isinstance(event, Odometry):
            if self._source == "odometry":
                return event
            if self._source == "imu":
                self._speed = event.vx_mps
                return None
            return self._integrate(event.stamp_ns, (event.vx_mps, event.vy_mps, event.yaw_rate_radps))
        if isinstance(event, Twist):
            if self._source == "imu":
                self._speed = event.vx_mps
                return None
            return self._integrate(event.stamp_ns, (event.vx_mps, event.vy_mps, event.yaw_rate_radps))
        if isinstance(event, YawRate):
            return self._integrate(event.stamp_ns, (self._speed, 0.0, event.yaw_rate_radps))
        if isinstance(event, Wheels | Ticks):
            return self._roll(event)
        return None

    def _integrate(self, stamp_ns: int, speed: tuple[float, float, float]) -> Odometry | None:
        """Mean speed over the interval, midpoint heading."""
        if not all(math.isfinite(v) for v in speed):
            return None
        dt = 0.0 if self._last_ns is None else (stamp_ns - self._last_ns) / SECOND
        vx, vy, w = ((a + b) / 2 for a, b in zip(speed, self._last_speed, strict=True))
        self._last_ns, self._last_speed = stamp_ns, speed
        return self._advance(stamp_ns, vx * dt, vy * dt, w * dt)

    def _advance(self, stamp_ns: int, dx: float, dy: float, dyaw: float) -> Odometry:
        x, y, yaw = self._pose
        middle = yaw + dyaw / 2
        c, s = math.cos(middle), math.sin(middle)
        self._pose = (x + c * dx - s * dy, y + s * dx + c * dy, math.remainder(yaw + dyaw, 2 * math.pi))
        return Odometry(stamp_ns, *self._pose)

    def _roll(self, event: Wheels | Ticks) -> Odometry | None:
        if not event.names:
            return None
        left, right = self._pick(event.names)
        drive = self._drive
        if isinstance(event, Ticks):
            turn = 2 * math.pi / event.ticks_per_turn
            counts = (int(event.ticks[left]), int(event.ticks[right]))
            if not event.cumulative:
                angles = (counts[0] * turn, counts[1] * turn)
                return self._wheel_step(event.stamp_ns, angles)
            before, self._wheels = self._wheels, (float(counts[0]), float(counts[1]))
            if before is None:
                self._last_ns = event.stamp_ns
                return Odometry(event.stamp_ns, *self._pose)
            steps = [_unwrapped(now - int(old)) * turn for now, old in zip(counts, before, strict=True)]
            return self._wheel_step(event.stamp_ns, (steps[0], steps[1]))
        position = (float(event.position_rad[left]), float(event.position_rad[right]))
        if all(math.isfinite(p) for p in position):
            before, self._wheels = self._wheels, position
            if before is None:
                self._last_ns = event.stamp_ns
                return Odometry(event.stamp_ns, *self._pose)
            return self._wheel_step(event.stamp_ns, (position[0] - before[0], position[1] - before[1]))
        speed = (
            float(event.velocity_radps[left]) * drive.radius_left_m,
            float(event.velocity_radps[right]) * drive.radius_right_m,
        )
        return self._integrate(event.stamp_ns, ((speed[0] + speed[1]) / 2, 0.0, (speed[1] - speed[0]) / drive.track_m))

    def _wheel_step(self, stamp_ns: int, angles: tuple[float, float]) -> Odometry:
        left, right = angles[0] * self._drive.radius_left_m, angles[1] * self._drive.radius_right_m
        seconds = 0.0 if self._last_ns is None else (stamp_ns - self._last_ns) / SECOND
        self._last_ns = stamp_ns
        if max(abs(left), abs(right)) > _FASTEST_MPS * max(seconds, _SHORTEST_S):
            self._loss.add(
                "jump of the encoders",
                f"wheel encoders jump by {max(abs(left), abs(right)):.1f} m within {seconds:.2f} s; such steps are left out"
                " (a counter that was reset, or --wheel-radius-m is wrong)",
            )
            return Odometry(stamp_ns, *self._pose)
        return self._advance(stamp_ns, (left + right) / 2, 0.0, (right - left) / self._drive.track_m)

    def _pick(self, names: tuple[str, ...]) -> tuple[int, int]:
        drive = self._drive
        if drive.radius_left_m <= 0 or drive.radius_right_m <= 0 or drive.track_m <= 0:
            raise UsageError("motion from encoders needs --wheel-radius-m and --track-width-m (both > 0)")
        wanted = drive.joints
        if wanted is None:
            guess = [[n for n in names if side in n.lower()] for side in ("left", "right")]
            if len(guess[0]) != 1 or len(guess[1]) != 1:
                raise UsageError(f"which wheels drive? The log has {', '.join(names)}; say --wheel-joints LEFT,RIGHT")
            wanted = (guess[0][0], guess[1][0])
        missing = [w for w in wanted if w not in names]
        if missing:
            raise UsageError(f"--wheel-joints: the log has no joint {missing[0]!r}, but {', '.join(names)}")
        return names.index(wanted[0]), names.index(wanted[1])


def _unwrapped(difference: int) -> int:
    """Tick difference of a 32 bit counter that may have wrapped."""
    return (difference + (1 << 31)) % (1 << 32) - (1 << 31) if abs(difference) > 1 << 31 else difference


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


def sweeps(
    events: Iterable[Event], source: str, drive: Drive, loss: Loss, max_gap_s: float = 1.0
) -> Iterator[Sweep | Sounding]:
    """Scans (or rounds of the range finders) with the odometry pose of their own stamp, interpolated between the motion
    events around it.

    A scan before the first or more than `max_gap_s` after the last motion event is counted in `loss`.
    """
    reckon = DeadReckoning(source, drive, loss)
    before: Odometry | None = None
    text = SourceStamp(-1, "")
    waiting: deque[tuple[Scan | Ranges, str]] = deque()
    for event in rounds(events):
        if isinstance(event, Scan | Ranges):
            name = text.text if text.stamp_ns == event.stamp_ns else ""
            if before is not None and before.stamp_ns == event.stamp_ns:
                yield _joined(event, before[1:4], name)
            else:
                waiting.append((event, name))
            continue
        if isinstance(event, SourceStamp):
            text = event
            continue
        after = reckon(event)
        if after is None:
            continue
        while waiting and waiting[0][0].stamp_ns <= after.stamp_ns:
            scan, name = waiting.popleft()
            if before is None and scan.stamp_ns < after.stamp_ns:
                loss.add("scan before odometry", "scans before the first odometry message have no pose")
                continue
            start = before if before is not None else after
            if (after.stamp_ns - start.stamp_ns) > max_gap_s * SECOND:
                loss.add(
                    "gap in odometry",
                    f"odometry pauses for {(after.stamp_ns - start.stamp_ns) / SECOND:.1f} s; poses there are interpolated",
                )
            yield _joined(scan, _interpolate(start, after, scan.stamp_ns), name)
        before = after
    for scan, name in waiting:
        if before is not None and scan.stamp_ns - before.stamp_ns <= max_gap_s * SECOND:
            yield _joined(scan, before[1:4], name)
        else:
            loss.add("scan without odometry", "scans after the last odometry message have no pose")


def bare(events: Iterable[Event]) -> Iterator[Sweep]:
    """Scans alone, as if the robot stood still."""
    return (Sweep(event.stamp_ns, (0.0, 0.0, 0.0), event, "") for event in events if isinstance(event, Scan))


def _joined(reading: Scan | Ranges, odometry: tuple[float, float, float], name: str) -> Sweep | Sounding:
    if isinstance(reading, Ranges):
        return Sounding(reading.stamp_ns, odometry, reading, name)
    return Sweep(reading.stamp_ns, odometry, reading, name)


def _interpolate(a: Odometry, b: Odometry, stamp_ns: int) -> tuple[float, float, float]:
    if b.stamp_ns == a.stamp_ns:
        return b[1:4]
    s = (stamp_ns - a.stamp_ns) / (b.stamp_ns - a.stamp_ns)
    turn = math.remainder(b.yaw_rad - a.yaw_rad, 2 * math.pi)
    return (a.x_m + s * (b.x_m - a.x_m), a.y_m + s * (b.y_m - a.y_m), math.remainder(a.yaw_rad + s * turn, 2 * math.pi))
