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
from pfcli.replay.scan_times import ScanTimes
from pfcli.replay.settings import AS_TOLD, Deskew, Drive

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
    events: Iterable[Event],
    source: str,
    drive: Drive,
    dropped: Dropped,
    max_gap_s: float = 1.0,
    deskew: Deskew = AS_TOLD,
) -> Iterator[Sweep | Sounding | Sighting]:
    """Scans (rounds of the range finders, sightings) with the odometry pose of their own stamp, interpolated between the
    motion events around it; the beams of a scan by the motion at their own time.

    A reading before the first or more than `max_gap_s` after the last motion event is counted in `dropped`.
    """
    reckon = DeadReckoning(source, drive, dropped)
    way = _Way(ScanTimes(deskew, dropped), reckon, dropped, max_gap_s)
    text = SourceStamp(-1, "")
    compass = _Compass()
    for event in sightings(rounds(events)):
        if isinstance(event, Scan | Ranges | Sighting):
            name = text.text if text.stamp_ns == event.stamp_ns else ""
            if isinstance(event, Sighting):
                event = compass.at(event)
            yield from way.read(event, name)
        elif isinstance(event, SourceStamp):
            text = event
        elif isinstance(event, Heading):
            compass.hear(event)
        else:
            odometry = reckon(event)
            if odometry is not None:
                yield from way.move(odometry)
    yield from way.end()


class _Waiting(NamedTuple):
    """A reading, what it is called, and the time (ns) from which on the motion that it wants is known."""

    reading: Scan | Ranges | Sighting
    name: str
    ready_ns: int


class _Way:
    """The motion of the last seconds, and the readings that wait for what comes next."""

    _KEPT_NS = 2 * SECOND

    def __init__(self, times: ScanTimes, reckon: DeadReckoning, dropped: Dropped, max_gap_s: float) -> None:
        self._times, self._reckon, self._dropped, self._max_gap_s = times, reckon, dropped, max_gap_s
        self._instants: deque[_Instant] = deque()
        self._waiting: deque[_Waiting] = deque()

    def read(self, reading: Scan | Ranges | Sighting, name: str) -> Iterator[Sweep | Sounding | Sighting]:
        """Take up a reading; one at the stamp of the last motion needs not wait."""
        last = self._times.span_ns(reading)[1] if isinstance(reading, Scan) else 0
        ready = reading.stamp_ns + max(0, last)
        known = bool(self._instants) and self._instants[-1].odometry.stamp_ns == ready
        if known and ready == reading.stamp_ns and not self._waiting:
            yield self._joined(reading, self._instants[-1], name)
        else:
            self._waiting.append(_Waiting(reading, name, ready))

    def move(self, odometry: Odometry) -> Iterator[Sweep | Sounding | Sighting]:
        """Take up motion; the readings that waited for it."""
        before = self._instants[-1] if self._instants else None
        now = _Instant(odometry, self._reckon.rolled, _travelled(before, odometry))
        self._instants.append(now)
        while self._waiting and self._waiting[0].ready_ns <= odometry.stamp_ns:
            reading, name, _ = self._waiting.popleft()
            if reading.stamp_ns < self._instants[0].odometry.stamp_ns:
                what = "sighting" if isinstance(reading, Sighting) else "scan"
                self._dropped.add(
                    f"{what} before odometry", f"{what}s before the first message of the motion source have no pose"
                )
                continue
            yield self._joined(reading, self._at(reading.stamp_ns), name)
        oldest = odometry.stamp_ns - self._KEPT_NS
        if self._waiting:
            oldest = min(oldest, self._waiting[0].reading.stamp_ns - self._KEPT_NS)
        while len(self._instants) > 2 and self._instants[1].odometry.stamp_ns <= oldest:
            self._instants.popleft()

    def end(self) -> Iterator[Sweep | Sounding | Sighting]:
        """What still waits: at the last pose, where that is not too old."""
        for reading, name, _ in self._waiting:
            if self._has_pose(reading.stamp_ns):
                yield self._joined(reading, self._at(reading.stamp_ns), name)
            else:
                what = "sighting" if isinstance(reading, Sighting) else "scan"
                self._dropped.add(
                    f"{what} without odometry", f"{what}s after the last message of the motion source have no pose"
                )

    def _has_pose(self, stamp_ns: int) -> bool:
        """Whether a stamp lies in what is known of the motion, or not too long after it."""
        if not self._instants:
            return False
        first, last = self._instants[0].odometry.stamp_ns, self._instants[-1].odometry.stamp_ns
        return first <= stamp_ns <= last + self._max_gap_s * SECOND

    def _at(self, stamp_ns: int) -> _Instant:
        """The motion at a stamp between the first and the last one that is known, or the last."""
        k = len(self._instants) - 1
        while k > 0 and self._instants[k - 1].odometry.stamp_ns >= stamp_ns:
            k -= 1
        after, before = self._instants[k], self._instants[max(0, k - 1)]
        if after.odometry.stamp_ns <= stamp_ns:
            return after
        gap_s = (after.odometry.stamp_ns - before.odometry.stamp_ns) / SECOND
        if gap_s > self._max_gap_s:
            self._dropped.add("gap in odometry", f"odometry pauses for {gap_s:.1f} s; poses there are interpolated")
        return _between(before, after, stamp_ns)

    def _joined(self, reading: Scan | Ranges | Sighting, at: _Instant, name: str) -> Sweep | Sounding | Sighting:
        if isinstance(reading, Scan) and self._times.span_ns(reading) != (0, 0):
            reading = self._times.placed(reading, at.odometry, [i.odometry for i in self._instants])
        return _joined(reading, at, name, self._reckon)


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
