"""How well a result agrees with what went in: measures that need no truth."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.checks.evidence import Evidence, usable_limits
from pfcli.core.evaluation.map_quality import doubled_walls
from pfcli.core.geometry import between
from pfcli.core.grid.distance import distance_m
from pfcli.core.grid.grid_map import GridMap
from pfcli.events import Scan
from pfcli.systems.shared.contract import Result

_JUMP_M, _JUMP_RAD = 0.5, 0.35
_NEAR_M, _LINE_NEAR_M = 0.15, 0.3
_WINDOW_NS = 60 * 1_000_000_000
_FARTHEST_M = 30.0


class Agreement(NamedTuple):
    """Measures of a result; NaN where they do not apply.

    with_pose: share of readings that have a pose; jumps: steps that are not the odometry's, by more than half a metre or 20
    degrees; settled: share of the poses in the longest stretch without one; way_ratio: way of the track, without jumps,
    against that of the motion source; fit: share of the end points of scans (points of lines) that lie on what the map or
    field shows, median over the readings looked at; fit_worst: the same of the worst minute; doubled: doubled walls of a map
    that was built, see `pfcli.core.evaluation.map_quality`.
    """

    with_pose: float
    jumps: int
    settled: float
    way_ratio: float
    fit: float
    fit_worst: float
    doubled: float


def agreement(result: Result, evidence: Evidence) -> Agreement:
    """Measure a result against the evidence of its run."""
    stamps, poses = result.track.stamps_ns, result.track.poses
    known = np.isfinite(poses).all(axis=1)
    jumps, settled, ratio = _steps(stamps[known], poses[known], evidence)
    fits = _fits(result, stamps[known], poses[known], evidence)
    built = result.grid is not None and not result.given_frame
    return Agreement(
        with_pose=float(known.mean()) if known.size else 0.0,
        jumps=jumps,
        settled=settled,
        way_ratio=ratio,
        fit=float(np.median(fits[:, 1])) if len(fits) else np.nan,
        fit_worst=_worst(fits),
        doubled=doubled_walls(result.grid) if built and result.grid is not None else np.nan,
    )


def _steps(stamps: NDArray[np.int64], poses: NDArray[np.float64], evidence: Evidence) -> tuple[int, float, float]:
    """Jumps, the longest stretch between two as a share, and the way of the track over that of the motion source."""
    if len(poses) < 2 or len(evidence.motion) < 2:
        return 0, np.nan, np.nan
    told = evidence.pose_at(np.asarray((stamps - (evidence.start_ns or 0)) * 1e-9, np.float64))
    moved, driven = between(poses[:-1], poses[1:]), between(told[:-1], told[1:])
    off = between(driven, moved)
    jumped = (np.hypot(off[:, 0], off[:, 1]) > _JUMP_M) | (np.abs(off[:, 2]) > _JUMP_RAD)
    ends = np.concatenate([[-1], np.flatnonzero(jumped), [len(jumped)]])
    settled = float(np.diff(ends).max()) / len(poses)
    way, gone = (float(np.hypot(step[~jumped, 0], step[~jumped, 1]).sum()) for step in (driven, moved))
    return int(jumped.sum()), settled, gone / way if way > 1.0 else np.nan


def _fits(
    result: Result, stamps: NDArray[np.int64], poses: NDArray[np.float64], evidence: Evidence
) -> NDArray[np.float64]:
    """(n, 2): stamp (ns) and share of the points on what the map shows, of the readings looked at that have a pose."""
    grid = result.grid
    if grid is None or not (grid.cells == 1).any() or not len(poses):
        return np.empty((0, 2))
    away_m = distance_m(grid.cells == 1, grid.resolution_m)
    partial = "in_map" in result.track.columns
    rows = []
    points = [(scan.stamp_ns, _ends(scan)) for scan in evidence.samples.scans]
    near = max(_NEAR_M, 1.5 * grid.resolution_m)
    if not points:
        points, near = [(event.stamp_ns, event.points_m) for event in evidence.lines], _LINE_NEAR_M
    for stamp, ends in points:
        k = int(np.searchsorted(stamps, stamp))
        if k >= len(stamps) or stamps[k] != stamp or len(ends) < 8:
            continue
        if partial and not result.track.columns["in_map"][k]:
            continue
        share = _share(ends, poses[k], grid, away_m, near, partial)
        if np.isfinite(share):
            rows.append((float(stamp), share))
    return np.array(rows).reshape(-1, 2)


def _ends(scan: Scan) -> NDArray[np.float64]:
    """End points (n, 2) of the beams that returned, in the base frame (m)."""
    low, high = usable_limits(scan)
    ranges = scan.ranges_m.astype(float)
    good = (ranges > low) & (ranges < min(high, _FARTHEST_M))
    angle = scan.directions_rad()[good]
    return np.column_stack(
        [
            scan.mount.x_m + ranges[good] * np.cos(angle),
            scan.mount.y_m + ranges[good] * np.sin(angle),
        ]
    )


def _share(
    ends: NDArray[np.float64],
    pose: NDArray[np.float64],
    grid: GridMap,
    away_m: NDArray[np.float64],
    near_m: float,
    partial: bool,
) -> float:
    """Share of points (n, 2) that lie within `near_m` of an occupied cell; partial: those in unknown cells do not count."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + c * ends[:, 0] - s * ends[:, 1], pose[1] + s * ends[:, 0] + c * ends[:, 1]
    c, s = np.cos(grid.origin.yaw_rad), np.sin(grid.origin.yaw_rad)
    dx, dy = x - grid.origin.x_m, y - grid.origin.y_m
    column = np.floor((c * dx + s * dy) / grid.resolution_m).astype(np.int64)
    row = np.floor((-s * dx + c * dy) / grid.resolution_m).astype(np.int64)
    rows, columns = grid.cells.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    row, column = np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)
    on = inside & (away_m[row, column] <= near_m)
    counted = on | (inside & (grid.cells[row, column] >= 0)) if partial else np.ones(on.size, np.bool_)
    return float(on.sum() / counted.sum()) if counted.sum() >= 8 else np.nan


def _worst(fits: NDArray[np.float64]) -> float:
    """The median of the worst minute that has at least four readings."""
    if len(fits) < 4:
        return np.nan
    stamps, shares = fits[:, 0], fits[:, 1]
    medians = []
    for begin in np.arange(stamps[0], stamps[-1] + 1, _WINDOW_NS / 2):
        here = shares[(stamps >= begin) & (stamps < begin + _WINDOW_NS)]
        if here.size >= 4:
            medians.append(float(np.median(here)))
    return min(medians, default=float(np.median(shares)))
