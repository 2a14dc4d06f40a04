"""A map against itself and against the true one: doubled walls, intersection over union."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pfcli.core.evaluation.se2 import between, compose
from pfcli.core.grid.grid_map import GridMap
from pfcli.events import Pose2


def doubled_walls(grid: GridMap, reach_m: float = 0.2) -> float:
    """Cells that a morphological closing of radius `reach_m` adds, per free cell that borders a wall.

    A wall drawn twice leaves a narrow gap, which the closing fills; a wall drawn once leaves none. Corners and clutter
    add a little to any map, so the score compares maps of one place, or a map with the true one. The border measures
    the length of the walls whatever their thickness: per occupied cell, blurred walls would score better than thin ones.
    """
    occupied = grid.cells == 1
    if not occupied.any():
        return 0.0
    r = max(1, round(reach_m / grid.resolution_m))
    y, x = np.ogrid[-r : r + 1, -r : r + 1]
    padded = np.pad(occupied, 2 * r)
    closed = ndimage.binary_closing(padded, x * x + y * y <= r * r)
    border = ndimage.binary_dilation(occupied) & (grid.cells == 0)
    return float((closed & ~padded).sum() / max(1, border.sum()))


class MapAgreement(NamedTuple):
    """Intersection over union of occupied cells (each met within one cell), and the pose that was used."""

    iou: float
    moved: Pose2


def map_iou(grid: GridMap, truth: GridMap, moved: Pose2) -> MapAgreement:
    """Intersection over union of the occupied cells of two maps, +- 1 cell, `grid` moved by `moved` into truth's frame.

    Only true surfaces that `grid` has seen (within one cell) count: an unexplored room is not an error.
    """
    rows, cols = np.nonzero(grid.cells == 1)
    res = grid.resolution_m
    local = np.stack(
        [grid.origin.x_m + (cols + 0.5) * res, grid.origin.y_m + (rows + 0.5) * res, np.zeros(rows.size)], 1
    )
    world = compose(np.array([moved]), local)
    gx = np.floor((world[:, 0] - truth.origin.x_m) / truth.resolution_m).astype(int)
    gy = np.floor((world[:, 1] - truth.origin.y_m) / truth.resolution_m).astype(int)
    inside = (gx >= 0) & (gy >= 0) & (gx < truth.cells.shape[1]) & (gy < truth.cells.shape[0])
    drawn = np.zeros(truth.cells.shape, bool)
    drawn[gy[inside], gx[inside]] = True
    seen = _seen(grid, truth, moved)
    real = (truth.cells == 1) & seen
    near = np.ones((3, 3), bool)
    drawn_near, real_near = ndimage.binary_dilation(drawn, near), ndimage.binary_dilation(truth.cells == 1, near)
    hits = (real & drawn_near).sum()
    union = real.sum() + (drawn & ~real_near).sum() + (~inside).sum()
    return MapAgreement(float(hits / max(1, union)), moved)


def _seen(grid: GridMap, truth: GridMap, moved: Pose2) -> NDArray[np.bool_]:
    """True cells that the moved grid knows."""
    rows, cols = np.indices(truth.cells.shape)
    x = truth.origin.x_m + (cols.ravel() + 0.5) * truth.resolution_m
    y = truth.origin.y_m + (rows.ravel() + 0.5) * truth.resolution_m
    back = between(np.array([moved]), np.stack([x, y, np.zeros(x.size)], 1))
    gx = np.floor((back[:, 0] - grid.origin.x_m) / grid.resolution_m).astype(int)
    gy = np.floor((back[:, 1] - grid.origin.y_m) / grid.resolution_m).astype(int)
    ok = (gx >= 0) & (gy >= 0) & (gx < grid.cells.shape[1]) & (gy < grid.cells.shape[0])
    known = np.zeros(x.size, bool)
    known[ok] = grid.cells[gy[ok], gx[ok]] >= 0
    return known.reshape(truth.cells.shape)
