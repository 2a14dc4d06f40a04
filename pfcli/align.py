"""From motion events of any kind to one odometry pose at each scan's own stamp."""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.motion import wheels
from pfcli.errors import UsageError
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

BASES = ("differential", "omni", "mecanum")
_CORNERS = (("front", "left"), ("front", "right"), ("rear", "left"), ("rear", "right"))

_FASTEST_MPS, _SHORTEST_S = 30.0, 0.1
"""No wheel of a robot runs faster; stamps of one burst may be nearer to each other than the motion they report."""


class Drive(NamedTuple):
    """A wheel base. base: `differential` (track_m), `omni` (arm_m from the centre; angle_deg: the paper's phi of four
    wheels, or the bearing of each wheel) or `mecanum` (track_m, axles_m apart). joints: of the wheels, in the base's order;
    radius_m: one for all, or one for each; ticks_per_turn: of joints whose position counts ticks (0: it is in rad)."""

    base: str = "differential"
    joints: tuple[str, ...] | None = None
    radius_m: tuple[float, ...] = ()
    track_m: float = 0.0
    axles_m: float = 0.0
    arm_m: float = 0.0
    angle_deg: tuple[float, ...] = ()
    ticks_per_turn: float = 0.0

    @property
    def sides(self) -> tuple[tuple[str, ...], ...]:
        """Words that tell the wheels of this base by their joints' names, in order; empty where names do not tell."""
        if self.base == "differential":
            return (("left",), ("right",))
        if self.base == "mecanum":
            return _CORNERS
        return tuple(_CORNERS[k] for k in (2, 0, 1, 3)) if len(self.angle_deg) == 1 else ()

    def jacobian(self) -> wheels.Jacobian:
        """Travel of each wheel per step of the robot. Raises UsageError naming the flag whose value is missing."""
        needed = {
            "differential": [("--track-width-m", self.track_m)],
            "omni": [("--wheel-arm-m", self.arm_m), ("--wheel-angle-deg", float(len(self.angle_deg)))],
            "mecanum": [("--track-width-m", self.track_m), ("--axle-distance-m", self.axles_m)],
        }[self.base]
        missing = [
            name for name, value in [("--wheel-radius-m", min(self.radius_m, default=0.0)), *needed] if value <= 0
        ]
        if missing:
            others = "; other wheels: --base" if self.base == BASES[0] else ""
            raise UsageError(
                f"motion from encoders needs {' and '.join(missing)} (> 0) of the {self.base} base{others}, or a --drive file"
            )
        if self.base == "differential":
            return wheels.differential(self.track_m)
        if self.base == "mecanum":
            return wheels.mecanum(self.axles_m / 2, self.track_m / 2)
        bearings = [math.radians(a) for a in self.angle_deg]
        if len(bearings) == 1:
            if not 0.0 < self.angle_deg[0] < 90.0:
                raise UsageError(
                    "--wheel-angle-deg: the angle of four wheels lies between 0 and 90; or give one per wheel"
                )
            bearings = list(wheels.four_places(bearings[0]))
        if len(bearings) < 3:
            raise UsageError("--wheel-angle-deg: an omni base has three wheels or more; give the bearing of each")
        found = wheels.omni(bearings, [self.arm_m] * len(bearings))
        if np.linalg.matrix_rank(found) < 3:
            raise UsageError(
                "--wheel-angle-deg: wheels at these bearings cannot tell every motion; three different are needed"
            )
        return found


class DeadReckoning:
    """Turns motion events into odometry poses (Zhang 2014, eqs (2)-(4); Zhang 2011, eq. (3)); ticks may wrap at 32 bits, and
    a jump of theirs that no robot can drive is counted in `loss` and left out.

    rolled: (2, k), how far each wheel has rolled, with its sign and without (m); jacobian: of the base, None before the
    first encoder message; back: its pseudo-inverse.
    """

    def __init__(self, source: str, drive: Drive, loss: Loss | None = None) -> None:
        self._loss = Loss() if loss is None else loss
        self._source = source
        self._drive = drive
        self._pose = (0.0, 0.0, 0.0)
        self._last_ns: int | None = None
        self._last_speed = (0.0, 0.0, 0.0)
        self._names: tuple[str, ...] = ()
        self._order = np.empty(0, np.int64)
        self._radius = np.empty(0)
        self.back = np.empty((3, 0))
        self._wheels: NDArray[Any] | None = None
        self.jacobian: wheels.Jacobian | None = None
        self.rolled = np.zeros((2, 0))
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
        if event.names != self._names:
            if self._names and not set(self._names) <= set(event.names):
                self._loss.add(
                    "message without the wheels",
                    f"a message of {', '.join(event.names)} names no wheels; it is left out",
                )
                return None
            self._rig(event.names)
        turn = (
            2
            * math.pi
            / (event.ticks_per_turn if isinstance(event, Ticks) else self._drive.ticks_per_turn or 2 * math.pi)
        )
        if isinstance(event, Ticks):
            counts = event.ticks[self._order]
            if not event.cumulative:
                return self._wheel_step(event.stamp_ns, counts * turn)
            before, self._wheels = self._wheels, counts
            if before is None:
                return self._stand(event.stamp_ns)
            steps = [_unwrapped(now - old) for now, old in zip(counts.tolist(), before.tolist(), strict=True)]
            return self._wheel_step(event.stamp_ns, np.array(steps) * turn)
        position = event.position_rad[self._order]
        if np.isfinite(position).all():
            before, self._wheels = self._wheels, position
            if before is None:
                return self._stand(event.stamp_ns)
            return self._wheel_step(event.stamp_ns, (position - before) * turn)
        rolling = event.velocity_radps[self._order] * self._radius
        if self._last_ns is not None and np.isfinite(rolling).all():
            travel = rolling * (event.stamp_ns - self._last_ns) / SECOND
            self.rolled = self.rolled + np.stack([travel, np.abs(travel)])
        speed = self.back @ rolling
        return self._integrate(event.stamp_ns, (float(speed[0]), float(speed[1]), float(speed[2])))

    def _stand(self, stamp_ns: int) -> Odometry:
        """The first reading of counters says where they stand, not how far the wheels came."""
        self._last_ns = stamp_ns
        return Odometry(stamp_ns, *self._pose)

    def _wheel_step(self, stamp_ns: int, angles: NDArray[Any]) -> Odometry:
        travel = angles * self._radius
        far = float(np.abs(travel).max())
        seconds = 0.0 if self._last_ns is None else (stamp_ns - self._last_ns) / SECOND
        self._last_ns = stamp_ns
        if far > _FASTEST_MPS * max(seconds, _SHORTEST_S):
            self._loss.add(
                "jump of the encoders",
                f"wheel encoders jump by {far:.1f} m within {seconds:.2f} s; such steps are left out"
                " (a counter that was reset, or --wheel-radius-m is wrong)",
            )
            return Odometry(stamp_ns, *self._pose)
        self.rolled = self.rolled + np.stack([travel, np.abs(travel)])
        dx, dy, dyaw = (self.back @ travel).tolist()
        return self._advance(stamp_ns, dx, dy, dyaw)

    def _rig(self, names: tuple[str, ...]) -> None:
        """Learn which of the log's joints is which wheel of the base."""
        drive = self._drive
        jacobian = drive.jacobian()
        count = jacobian.shape[0]
        wanted = drive.joints
        if wanted is None:
            wanted = tuple(n for side in drive.sides for n in names if all(word in n.lower() for word in side))
            if len(wanted) != count or len(set(wanted)) != count:
                order = ",".join(" ".join(side).upper().replace(" ", "_") for side in drive.sides)
                how = order or "with their names, in the order of --wheel-angle-deg"
                raise UsageError(f"which wheel is which? The log has {', '.join(names)}; say --wheel-joints {how}")
        if len(wanted) != count:
            raise UsageError(f"--wheel-joints names {len(wanted)} wheels, the {drive.base} base has {count}")
        missing = [w for w in wanted if w not in names]
        if missing:
            raise UsageError(f"--wheel-joints: the log has no joint {missing[0]!r}, but {', '.join(names)}")
        if len(drive.radius_m) not in (1, count):
            raise UsageError(
                f"--wheel-radius-m is given {len(drive.radius_m)} times; give it once, or once for each of {count} wheels"
            )
        self._names, self._order = names, np.array([names.index(w) for w in wanted])
        self._radius = np.array(drive.radius_m if len(drive.radius_m) == count else drive.radius_m * count)
        self.back = wheels.inverse(jacobian)
        self.jacobian = jacobian
        if self.rolled.shape[1] != count:
            self.rolled = np.zeros((2, count))


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
    events: Iterable[Event], source: str, drive: Drive, loss: Loss, max_gap_s: float = 1.0
) -> Iterator[Sweep | Sounding | Sighting]:
    """Scans (rounds of the range finders, sightings) with the odometry pose of their own stamp, interpolated between the
    motion events around it.

    A reading before the first or more than `max_gap_s` after the last motion event is counted in `loss`.
    """
    reckon = DeadReckoning(source, drive, loss)
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
                loss.add(
                    f"{what} before odometry", f"{what}s before the first message of the motion source have no pose"
                )
                continue
            start = before if before is not None else after
            gap_s = (odometry.stamp_ns - start.odometry.stamp_ns) / SECOND
            if gap_s > max_gap_s:
                loss.add("gap in odometry", f"odometry pauses for {gap_s:.1f} s; poses there are interpolated")
            yield _joined(reading, _between(start, after, reading.stamp_ns), name, reckon)
        before = after
    for reading, name in waiting:
        if before is not None and reading.stamp_ns - before.odometry.stamp_ns <= max_gap_s * SECOND:
            yield _joined(reading, before, name, reckon)
        else:
            what = "sighting" if isinstance(reading, Sighting) else "scan"
            loss.add(f"{what} without odometry", f"{what}s after the last message of the motion source have no pose")


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
