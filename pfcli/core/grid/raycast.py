"""Exact ray casting on a grid: from cell to cell, in strides as long as the free square around each cell allows."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pfcli.core.grid.distance import distance_m
from pfcli.core.jit import inline_kernel, kernel
from pfcli.core.threads import spread

NONE, UNKNOWN = np.inf, -1.0
"""What a ray brings that meets nothing within its range, and one that runs into cells of which nothing is known."""


def clearance(cells: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Chebyshev distance in cells to the next cell that stops a ray: 0 in occupied and unknown cells, at most 255.

    cells: int8 (rows, cols), 1 occupied, 0 free, -1 unknown; what lies off the grid counts as unknown.
    """
    free = np.pad(cells == 0, 1)
    away = ndimage.distance_transform_cdt(free, metric="chessboard")[1:-1, 1:-1]
    return np.ascontiguousarray(np.minimum(away, 255), np.uint8)


def unveiled(cells: NDArray[np.int8], resolution_m: float, veil_m: float) -> NDArray[np.int8]:
    """The map with unknown cells made free where rays have only missed them: within veil_m of an occupied cell, and in gaps of
    what is known that are no wider than twice that (the morphological closing)."""
    known, pad = cells != -1, 2 * math.ceil(veil_m / resolution_m) + 2
    grown = distance_m(np.pad(known, pad), resolution_m) <= veil_m
    closed = (distance_m(~grown, resolution_m) > veil_m)[pad:-pad, pad:-pad]
    near = distance_m(cells == 1, resolution_m) <= veil_m
    return np.where(~known & (near | closed), 0, cells).astype(np.int8)


def wall_thickness_m(cells: NDArray[np.int8], resolution_m: float, most_m: float = 0.5) -> float:
    """How thick the walls of a map are drawn: the median run of occupied cells, along rows or columns, whichever is
    shorter at each cell that borders on a free one; solid blocks count `most_m`."""
    occupied = cells == 1
    edge = occupied & ndimage.binary_dilation(cells == 0)
    if not edge.any():
        return resolution_m
    runs = np.minimum(_runs(occupied), _runs(occupied.T).T)[edge]
    return float(min(most_m, np.median(runs) * resolution_m))


def _runs(marked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Length of the run along its row that each marked cell belongs to, 0 elsewhere."""
    padded = np.pad(marked, ((0, 0), (1, 1)))
    starts = padded & ~np.roll(padded, 1, axis=1)
    label = np.where(padded, np.cumsum(starts.ravel()).reshape(padded.shape), 0)
    length = np.bincount(label.ravel())
    length[0] = 0
    return np.asarray(length[label][:, 1:-1])


@inline_kernel
def cast(room, cells, x, y, ux, uy, reach):
    """Length of the ray from (x, y) along the unit vector (ux, uy), all in cells: to the border of the first occupied
    cell, NONE beyond `reach`, UNKNOWN where an unknown cell comes first. room: `clearance` of cells.

    The cells that it visits are those of a cell by cell walk (Amanatides 1987): a stride ends at the border of a square
    that is known to be free, and is measured from the start of the ray.
    """
    rows, cols = room.shape
    ix, iy = np.int64(np.floor(x)), np.int64(np.floor(y))
    inverse_x = 1.0 / ux if ux != 0.0 else np.inf
    inverse_y = 1.0 / uy if uy != 0.0 else np.inf
    t = 0.0
    while t <= reach:
        if ix < 0 or iy < 0 or ix >= cols or iy >= rows:
            return -1.0
        d = np.int64(room[iy, ix])
        if d == 0:
            return t if cells[iy, ix] == 1 else -1.0
        tx = ((ix + d if ux > 0.0 else ix - d + 1) - x) * inverse_x if ux != 0.0 else np.inf
        ty = ((iy + d if uy > 0.0 else iy - d + 1) - y) * inverse_y if uy != 0.0 else np.inf
        if tx < ty:
            t = tx
            iy = min(max(np.int64(np.floor(y + t * uy)), iy - d + 1), iy + d - 1)
            ix = ix + d if ux > 0.0 else ix - d
        else:
            t = ty
            ix = min(max(np.int64(np.floor(x + t * ux)), ix - d + 1), ix + d - 1)
            iy = iy + d if uy > 0.0 else iy - d
    return np.inf


@kernel
def cast_many(room, cells, xy, directions, reach):
    """`cast` for each of (n, 2) places and (n,) directions (rad, grid frame), in cells. Returns (n,)."""
    out = np.empty(xy.shape[0])
    for k in range(xy.shape[0]):
        out[k] = cast(room, cells, xy[k, 0], xy[k, 1], np.cos(directions[k]), np.sin(directions[k]), reach)
    return out


@kernel
def _around_rows(low, high, room, cells, frame, xy, directions, range_m, out):
    cell_m = 1.0 / np.hypot(frame[0], frame[3])
    for i in range(low, high):
        x = frame[0] * xy[i, 0] + frame[1] * xy[i, 1] + frame[2]
        y = frame[3] * xy[i, 0] + frame[4] * xy[i, 1] + frame[5]
        for k in range(directions.shape[0]):
            r = cast(room, cells, x, y, directions[k, 0], directions[k, 1], range_m / cell_m) * cell_m
            out[i, k] = np.nan if r < 0.0 else min(r, range_m)


def cast_around(
    room: NDArray[np.uint8],
    cells: NDArray[np.int8],
    frame: NDArray[np.float64],
    xy: NDArray[np.float64],
    bins: int,
    range_m: float,
) -> NDArray[np.float32]:
    """(n, bins) range (m) from places (n, 2), map frame, along every direction of the grid; range_m where nothing is
    hit, NaN where an unknown cell comes first."""
    turn = 2 * np.pi * np.arange(bins) / bins
    out = np.empty((xy.shape[0], bins), np.float32)
    directions = np.column_stack([np.cos(turn), np.sin(turn)])
    spread(_around_rows, xy.shape[0], room, cells, frame, np.ascontiguousarray(xy), directions, range_m, out)
    return out
