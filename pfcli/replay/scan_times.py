"""When each beam of a scan was measured, and the scan as if all had been at its stamp."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.deskew import deskewed
from pfcli.dropped import Dropped
from pfcli.events import Odometry, Pose2, Scan
from pfcli.findings import Finding
from pfcli.replay.settings import Deskew

_SECOND = 1_000_000_000
_LONGEST_S = 1.0
"""No scanner takes longer for one scan."""
_TOO_LONG = 1.2
"""Times between beams that add up to this many times the time between scans are none."""


class ScanTimes:
    """When the beams of scans were measured: as asked, else by the log's own `time_increment`, else by `scan_time` where the
    turn rates prefer it (`by_scan_time`)."""

    def __init__(self, wanted: Deskew, dropped: Dropped) -> None:
        self._wanted, self._dropped = wanted, dropped

    def span_ns(self, scan: Scan) -> tuple[int, int]:
        """From its stamp: when the first and when the last beam was measured (ns); 0, 0 where all are at the stamp."""
        seconds = self._seconds(scan)
        if seconds == 0.0:
            return 0, 0
        whole = int(seconds * _SECOND)
        first = {"first": 0, "middle": -whole // 2, "last": -whole}[self._wanted.stamp]
        return first, first + whole

    def _seconds(self, scan: Scan) -> float:
        """From the first beam to the last (s)."""
        wanted, steps = self._wanted, scan.ranges_m.size - 1
        if not wanted.on or steps < 1:
            return 0.0
        if wanted.duration_s is not None:
            return wanted.duration_s
        told = steps * scan.time_increment_s
        if 0.0 < told <= _LONGEST_S and (scan.scan_time_s == 0.0 or told <= _TOO_LONG * scan.scan_time_s):
            return told
        if told > 0.0:
            self._dropped.find(_too_long(scan, told))
        if not wanted.by_scan_time:
            return 0.0
        return min(scan.scan_time_s * swept(scan), _LONGEST_S)

    def placed(self, scan: Scan, at_stamp: Odometry, history: Sequence[Odometry]) -> Scan:
        """The scan with every beam where it ended, seen from the pose at its stamp. history: the motion around it."""
        first, last = self.span_ns(scan)
        times = np.array([o.stamp_ns - scan.stamp_ns for o in history], np.float64)
        known = np.array([o[1:4] for o in history], np.float64)
        beams = np.linspace(float(first), float(last), scan.ranges_m.size)
        yaw = _unwrapped(known[:, 2])
        poses = np.stack([np.interp(beams, times, v) for v in (known[:, 0], known[:, 1], yaw)], axis=1)
        turns = _nearest(at_stamp.yaw_rad, float(np.interp(0.0, times, yaw)))
        reference = np.array([at_stamp.x_m, at_stamp.y_m, at_stamp.yaw_rad + turns])
        mount, reach = (scan.mount.x_m, scan.mount.y_m), (scan.range_min_m, scan.range_max_m)
        ranges, bearings = deskewed(scan.ranges_m, scan.directions_rad(), (mount, mount), reach, poses, reference)
        self._dropped.read["scans that were de-skewed"] += 1
        return scan._replace(ranges_m=ranges, bearings_rad=bearings, mount=Pose2(*mount, 0.0), range_min_m=0.0)


def _unwrapped(yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Headings without jumps of a turn."""
    step = np.diff(yaw)
    return yaw - 2 * math.pi * np.concatenate([[0.0], np.cumsum(np.round(step / (2 * math.pi)))])


def _nearest(angle: float, other: float) -> float:
    """The whole turns that bring an angle next to another one."""
    return 2 * math.pi * round((other - angle) / (2 * math.pi))


def swept(scan: Scan) -> float:
    """Share of a turn that the beams sweep."""
    return min(1.0, abs(scan.angle_increment_rad) * scan.ranges_m.size / (2 * math.pi))


def _too_long(scan: Scan, told_s: float) -> Finding:
    return Finding(
        code="W303",
        severity="doubt",
        where=f"topic {scan.topic!r}" if scan.topic else "the scan",
        seen=f"{scan.ranges_m.size} beams of time_increment {scan.time_increment_s:g} s take {told_s:.3f} s, and scan_time is"
        f" {scan.scan_time_s:g} s",
        effect="time_increment is not used to de-skew the scans",
        way_out="say --scan-duration S, or --no-deskew",
    )
