"""What checks look at: what a replay says, kept in bounded memory, and what scans say of the motion between them."""

from array import array
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.checks.scan_samples import ScanSamples
from pfcli.core.grid.scan_pair import pair_motion
from pfcli.events import Event, Heading, LinePoints, Odometry, Range, Scan, Ticks, Twist, Wheels, YawRate

_ROWS = 1 << 18
_POINTS = 200
_FARTHEST_M = 80.0

_COLUMNS = {Odometry: 7, Twist: 4, Heading: 3, YawRate: 2}


class Topic(NamedTuple):
    """When the messages of a role were recorded and when they say that they were made: log_ns, stamp_ns (n,), in file order."""

    where: str
    log_ns: NDArray[np.int64]
    stamp_ns: NDArray[np.int64]


class Pairs(NamedTuple):
    """Pairs of scans a moment apart, in order of time: stamps (n, 2) ns; by_scans (n, 3): the step of the scanner by the scans
    alone; by_motion (n, 3): the same by the motion source (m, m, rad, sensor frame); inliers, held (n,): see
    `pfcli.core.grid.scan_pair`."""

    stamps: NDArray[np.int64]
    by_scans: NDArray[np.float64]
    by_motion: NDArray[np.float64]
    inliers: NDArray[np.float64]
    held: NDArray[np.float64]


class _Rows:
    """Rows of numbers; where there are too many, every second is left out, again and again."""

    def __init__(self, width: int) -> None:
        self.width, self._data = width, array("d")
        self._every, self._skip = 1, 0

    def add(self, row: Iterable[float]) -> None:
        self._skip += 1
        if self._skip < self._every:
            return
        self._skip = 0
        self._data.extend(row)
        if len(self._data) >= _ROWS * self.width:
            kept = self.rows()[::2]
            self._data = array("d", kept.ravel().tobytes())
            self._every *= 2

    def rows(self) -> NDArray[np.float64]:
        return np.array(self._data, np.float64).reshape(-1, self.width)


class Evidence:
    """Heard on the way of a replay (`stamps`, `event`, `moved`), looked at by checks afterwards.

    path: of the log, for messages; pairs: how many pairs of scans are matched at the most; map_file: YAML of the map of the
    run, if any; source: where its motion comes from. Stamps in rows are seconds since `start_ns`, so that doubles tell
    nanoseconds apart.
    """

    def __init__(self, path: Path, pairs: int = 96, map_file: Path | None = None, source: str = "odometry") -> None:
        self.path, self.map_file, self.source = path, map_file, source
        self.start_ns: int | None = None
        self.wheels: list[Wheels] = []
        self.lines: list[LinePoints] = []
        self.ticks = 0
        self.range_rows: dict[str, _Rows] = {}
        self.range_limits: dict[str, tuple[float, float]] = {}
        self.where: dict[str, str] = {}
        self.samples = ScanSamples(pairs)
        self._rows = {kind: _Rows(width) for kind, width in _COLUMNS.items()}
        self._moved = _Rows(4)
        self._topics: dict[str, tuple[str, list[NDArray[np.int64]], list[NDArray[np.int64]]]] = {}
        self._line_count, self._wheel_count = 0, 0

    def stamps(self, role: str, where: str, log_ns: NDArray[np.int64], stamp_ns: NDArray[np.int64]) -> None:
        """Messages of a role: when they were recorded, and their stamps (n,), in file order."""
        first = self.where.setdefault(role, where)
        kept = self._topics.setdefault(role if where == first else f"{role} {where}", (where, [], []))
        kept[1].append(log_ns)
        kept[2].append(stamp_ns)

    def event(self, event: Event) -> None:
        """A message, in order of time."""
        if self.start_ns is None:
            self.start_ns = event.stamp_ns
        rows = self._rows.get(type(event))
        if rows is not None:
            rows.add(((event.stamp_ns - self.start_ns) * 1e-9, *event[1 : rows.width]))
        elif isinstance(event, Scan):
            self.samples.add(event)
        elif isinstance(event, Wheels):
            self._wheel_count += 1
            if len(self.wheels) < _ROWS // 8:
                self.wheels.append(event)
        elif isinstance(event, LinePoints):
            self._line_count += 1
            if event.points_m.size and len(self.lines) < _POINTS:
                self.lines.append(event)
        elif isinstance(event, Ticks):
            self.ticks += 1
        elif isinstance(event, Range):
            self.range_rows.setdefault(event.topic, _Rows(1)).add((event.range_m,))
            self.range_limits[event.topic] = (event.range_min_m, event.range_max_m)

    def moved(self, stamp_ns: int, pose: tuple[float, float, float]) -> None:
        """Where the robot is by the motion source of the run."""
        if self.start_ns is None:
            self.start_ns = stamp_ns
        self._moved.add(((stamp_ns - self.start_ns) * 1e-9, *pose))

    @cached_property
    def topics(self) -> dict[str, Topic]:
        """Role -> its stamps."""
        return {
            role: Topic(where, np.concatenate(log), np.concatenate(stamp))
            for role, (where, log, stamp) in self._topics.items()
        }

    @cached_property
    def odometry(self) -> NDArray[np.float64]:
        """(n, 7): s, pose (m, m, rad), twist (m/s, m/s, rad/s; NaN where there is none)."""
        return self._rows[Odometry].rows()

    @cached_property
    def twist(self) -> NDArray[np.float64]:
        """(n, 4): s, m/s, m/s, rad/s."""
        return self._rows[Twist].rows()

    @cached_property
    def compass(self) -> NDArray[np.float64]:
        """(n, 3): s, rad, its standard deviation."""
        return self._rows[Heading].rows()

    @cached_property
    def gyro(self) -> NDArray[np.float64]:
        """(n, 2): s, rad/s."""
        return self._rows[YawRate].rows()

    @cached_property
    def motion(self) -> NDArray[np.float64]:
        """(n, 4): s, pose by the motion source of the run, else by the odometry; the heading is unwrapped."""
        rows = self._moved.rows()
        if len(rows) < 2 or (self.odometry.size and self._odometry_drives(rows)):
            rows = self.odometry[:, :4].copy()
        rows = rows[np.isfinite(rows).all(axis=1)]
        rows[:, 3] = np.unwrap(rows[:, 3])
        return rows

    def _odometry_drives(self, moved: NDArray[np.float64]) -> bool:
        """Whether the motion of the run is the odometry itself, which is denser."""
        at = np.interp(moved[:, 0], self.odometry[:, 0], self.odometry[:, 1])
        return bool(np.nanmax(np.abs(at - moved[:, 1])) < 1e-3)

    def pose_at(self, seconds: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3): the motion's pose at stamps (s), heading unwrapped."""
        rows = self.motion
        return np.column_stack([np.interp(seconds, rows[:, 0], rows[:, k]) for k in (1, 2, 3)])

    @cached_property
    def pairs(self) -> Pairs:
        """Pairs of scans, matched."""
        rows = list(self._matched())
        if not rows or len(self.motion) < 2:
            empty = np.empty((0, 3))
            return Pairs(np.empty((0, 2), np.int64), empty, empty, np.empty(0), np.empty(0))
        stamps = np.array([row[0] for row in rows], np.int64)
        found = np.array([row[1] for row in rows])
        mounts = np.array([row[2] for row in rows])
        seconds = np.asarray((stamps - (self.start_ns or 0)) * 1e-9, np.float64)
        steps = sensor_steps(self.pose_at(seconds[:, 0]), self.pose_at(seconds[:, 1]), mounts)
        return Pairs(stamps, found[:, :3], steps, found[:, 3], found[:, 4])

    def _matched(self) -> Iterator[tuple[tuple[int, int], Any, tuple[float, float, float]]]:
        for first, second in self.samples.pairs:
            if first.ranges_m.size != second.ranges_m.size or first.ranges_m.size < 20 or first.bearings_rad.size:
                continue
            angles = (first.angle_min_rad, first.angle_increment_rad)
            found = pair_motion(first.ranges_m, second.ranges_m, angles, usable_limits(first))
            yield (first.stamp_ns, second.stamp_ns), found, (first.mount.x_m, first.mount.y_m, first.mount.yaw_rad)


def usable_limits(scan: Scan) -> tuple[float, float]:
    """Ranges (m) of a scan that a surface can have."""
    high = scan.range_max_m if scan.range_max_m > 0 else _FARTHEST_M
    return max(0.0, scan.range_min_m), min(0.995 * high, _FARTHEST_M)


def sensor_steps(
    before: NDArray[np.float64], after: NDArray[np.float64], mounts: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Steps (n, 3) of a sensor, in its own frame, where its robot goes from `before` to `after` (n, 3)."""

    def placed(pose: NDArray[np.float64]) -> NDArray[np.float64]:
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        x = pose[:, 0] + c * mounts[:, 0] - s * mounts[:, 1]
        y = pose[:, 1] + s * mounts[:, 0] + c * mounts[:, 1]
        return np.column_stack([x, y, pose[:, 2] + mounts[:, 2]])

    a, b = placed(before), placed(after)
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    return np.column_stack([c * dx + s * dy, -s * dx + c * dy, b[:, 2] - a[:, 2]])
