"""The map with what the robot saw beyond it: one robot's scans in the map of another (Zhang 2010, section 1)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid import tiles
from pfcli.core.grid.grid_map import GridMap
from pfcli.core.grid.scan_odometry import draw_one
from pfcli.events import Pose2
from pfcli.systems.shared.tile_map import grid_of


def extended(grid: GridMap, scans: list[tiles.Beams], poses: NDArray[np.float64]) -> GridMap:
    """The map in its own frame, grown; its unknown cells are as the scans show them, drawn at the poses (n, 3; NaN: not)."""
    maps, drawn = tiles.empty(1, grid.resolution_m), False
    for scan, pose in zip(scans, poses, strict=True):
        if np.isfinite(pose).all():
            maps, drawn = draw_one(maps, pose, scan), True
    return merged(grid, grid_of(maps, 0)) if drawn else grid


def merged(grid: GridMap, more: GridMap) -> GridMap:
    """A map whose unknown cells are filled from another one, and which reaches as far as both; frame and cells of the first."""
    c, s = np.cos(grid.origin.yaw_rad), np.sin(grid.origin.yaw_rad)
    # corners of the other one, in cells of this one
    rows, cols = more.cells.shape
    corner = np.array([(x, y) for x in (0, cols) for y in (0, rows)]) * more.resolution_m
    away = _placed(corner, more.origin) - [grid.origin.x_m, grid.origin.y_m]
    at = away @ np.array([[c, -s], [s, c]]) / grid.resolution_m
    low = np.minimum(0, np.floor(at.min(axis=0) + 1e-6)).astype(int)
    high = np.maximum([grid.cells.shape[1], grid.cells.shape[0]], np.ceil(at.max(axis=0) - 1e-6)).astype(int)
    cells = np.full((high[1] - low[1], high[0] - low[0]), -1, np.int8)
    cells[-low[1] :, -low[0] :][: grid.cells.shape[0], : grid.cells.shape[1]] = grid.cells
    x, y = _placed(low[None] * grid.resolution_m, grid.origin)[0].tolist()
    origin = Pose2(x, y, grid.origin.yaw_rad)
    row, col = np.nonzero(cells == -1)
    there = _placed((np.stack([col, row], axis=1) + 0.5) * grid.resolution_m, origin) - [
        more.origin.x_m,
        more.origin.y_m,
    ]
    c, s = np.cos(more.origin.yaw_rad), np.sin(more.origin.yaw_rad)
    found = np.floor(there @ np.array([[c, -s], [s, c]]) / more.resolution_m).astype(int)
    inside = ((found >= 0) & (found < [cols, rows])).all(axis=1)
    cells[row[inside], col[inside]] = more.cells[found[inside, 1], found[inside, 0]]
    return GridMap(cells, grid.resolution_m, origin)


def _placed(points: NDArray[Any], origin: Pose2) -> NDArray[np.float64]:
    """Points (n, 2) of a grid in the map frame (m)."""
    c, s = np.cos(origin.yaw_rad), np.sin(origin.yaw_rad)
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + [origin.x_m, origin.y_m])
