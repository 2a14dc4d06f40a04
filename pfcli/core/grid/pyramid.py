"""Where in a map a scan lies, however far from where it is thought: branch and bound over grids of ever coarser cells.

Olson 2009 (many-to-one correlation); Hess 2016, section V-B (the same bound, depth first). A level holds for each cell the
largest likelihood within 2^level cells up and to the right, so that one look-up bounds a whole square of offsets.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.distance import distance_m
from pfcli.core.jit import kernel

_MOST_CELLS = 4_000_000
"""Cells of a level at most: a map beyond takes coarser ones."""
_NEARER, _STEP = 0.9, 1.5
"""From one heading to the next, points nearer than this share of all but move by so many cells at most."""
_SIGMAS = 3.0
"""Beyond so many standard deviations of an end point there is nothing."""


class Pyramid(NamedTuple):
    """levels: uint8 (levels, rows, cols), likelihood of an end point, 255 on a surface; corner (2,): of the cell [0, 0], m, map
    frame; cell_m: side of a cell."""

    levels: NDArray[np.uint8]
    corner: NDArray[np.float64]
    cell_m: float


class Region(NamedTuple):
    """Poses to search: middle (3,) m, rad; half widths."""

    middle: NDArray[np.float64]
    half_xy_m: float
    half_yaw_rad: float


class Place(NamedTuple):
    """The best pose (3,) m, rad, and the mean likelihood of the end points there, 0 .. 1; -1 where none reaches the least."""

    pose: NDArray[np.float64]
    score: float


def build(points: NDArray[np.float64], sigma_m: float, cell_m: float, levels: int = 6) -> Pyramid:
    """The pyramid of surface points (n, 2), m. sigma_m: spread of an end point at that grain."""
    margin = _SIGMAS * sigma_m
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    cell_m = max(cell_m, float(np.sqrt(np.prod(high - low) / _MOST_CELLS)))
    cols, rows = (np.ceil((high - low) / cell_m).astype(np.int64) + 1).tolist()
    surface = np.zeros((rows, cols), np.bool_)
    at = ((points - low) / cell_m).astype(np.int64)
    surface[at[:, 1], at[:, 0]] = True
    away = distance_m(surface, cell_m) / sigma_m
    fine = np.where(away < _SIGMAS, 255.0 * np.exp(-0.5 * away * away), 0.0).astype(np.uint8)
    out = np.empty((levels, rows, cols), np.uint8)
    out[0] = fine
    for level in range(1, levels):
        out[level] = _wider(out[level - 1], 1 << (level - 1))
    return Pyramid(out, low, cell_m)


def _wider(grid: NDArray[np.uint8], by: int) -> NDArray[np.uint8]:
    """Of each cell the largest of itself and those `by` up, to the right, and both."""
    out = grid.copy()
    np.maximum(out[:, :-by], grid[:, by:], out=out[:, :-by])
    across = out.copy()
    np.maximum(out[:-by], across[by:], out=out[:-by])
    return out


def search(
    pyramid: Pyramid, points: NDArray[np.float64], region: Region, least: float, elsewhere: Place | None = None
) -> Place:
    """The pose in the region at which the points (b, 2), m, base frame, lie best on surfaces.

    least: mean likelihood that it must exceed. elsewhere: look for the best pose at least two metres from that place.
    """
    reach = max(float(np.quantile(np.hypot(points[:, 0], points[:, 1]), _NEARER)), pyramid.cell_m)
    step = _STEP * pyramid.cell_m / reach
    half = int(np.ceil(region.half_yaw_rad / step))
    avoid = np.full(2, np.inf) if elsewhere is None else elsewhere.pose[:2]
    pose, score = np.empty(3), np.empty(1)
    _search(pyramid.levels, pyramid.corner, pyramid.cell_m, points, region, step, half, least, avoid, pose, score)
    return Place(pose, float(score[0]))


_APART_M = 2.0
"""Two places are two from so far apart on."""


@kernel
def _rotated(points, yaw, corner, cell_m, x, y, out):
    """Cells (b, 2) of the points seen from the pose."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    for b in range(points.shape[0]):
        out[b, 0] = int(np.floor((x + cos * points[b, 0] - sin * points[b, 1] - corner[0]) / cell_m))
        out[b, 1] = int(np.floor((y + sin * points[b, 0] + cos * points[b, 1] - corner[1]) / cell_m))


@kernel
def _bound(grid, width, cells, dx, dy, least):
    """Sum of a level, whose cells look `width` cells ahead, at the cells (b, 2) moved by (dx, dy) cells; -1 as soon as it cannot
    exceed `least`. Cells left of the grid, or below it, may look into it: its first ones bound what they see.
    """
    rows, cols = grid.shape
    total, rest = 0, 255 * cells.shape[0]
    for b in range(cells.shape[0]):
        c, r = cells[b, 0] + dx, cells[b, 1] + dy
        rest -= 255
        if -width < c < cols and -width < r < rows:
            total += grid[max(r, 0), max(c, 0)]
        if total + rest <= least:
            return -1
    return total


@kernel
def _search(levels, corner, cell_m, points, region, step, half, least, avoid, pose, score):
    count, top = points.shape[0], levels.shape[0] - 1
    wide, n_xy = 1 << top, int(np.ceil(region.half_xy_m / cell_m))
    side = (2 * n_xy) // wide + 1
    turns = 2 * half + 1
    cells = np.empty((turns, count, 2), np.int32)
    bounds = np.empty(turns * side * side, np.int64)
    best = int(least * 255 * count)
    for a in range(turns):
        yaw = region.middle[2] + (a - half) * step
        _rotated(points, yaw, corner, cell_m, region.middle[0], region.middle[1], cells[a])
        for k in range(side * side):
            dx, dy = (k % side) * wide - n_xy, (k // side) * wide - n_xy
            bounds[a * side * side + k] = _bound(levels[top], wide, cells[a], dx, dy, best)
    score[0] = -1.0
    stack = np.empty((4 * top + 4, 4), np.int64)
    for k in np.argsort(-bounds):
        if bounds[k] <= best:
            break
        a, rest = k // (side * side), k % (side * side)
        stack[0, 0], stack[0, 1] = (rest % side) * wide - n_xy, (rest // side) * wide - n_xy
        stack[0, 2], stack[0, 3] = top, bounds[k]
        height = 1
        while height > 0:
            height -= 1
            dx, dy, level, bound = stack[height]
            if bound <= best:
                continue
            if level == 0:
                x, y = region.middle[0] + dx * cell_m, region.middle[1] + dy * cell_m
                if (x - avoid[0]) ** 2 + (y - avoid[1]) ** 2 >= _APART_M * _APART_M:
                    best = bound
                    pose[0], pose[1], pose[2] = x, y, region.middle[2] + (a - half) * step
                    score[0] = bound / (255.0 * count)
                continue
            half_side = 1 << (level - 1)
            first = height
            for child in range(4):
                cx, cy = dx + (child & 1) * half_side, dy + (child >> 1) * half_side
                value = _bound(levels[level - 1], half_side, cells[a], cx, cy, best)
                if value > best:
                    put_at = height  # kept in ascending order, so that the best is taken first
                    while put_at > first and stack[put_at - 1, 3] > value:
                        for c in range(4):
                            stack[put_at, c] = stack[put_at - 1, c]
                        put_at -= 1
                    stack[put_at, 0], stack[put_at, 1], stack[put_at, 2], stack[put_at, 3] = cx, cy, level - 1, value
                    height += 1
