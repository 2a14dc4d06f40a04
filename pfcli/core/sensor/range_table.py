"""Expected ranges from a table: one row per free cell, one column per direction. Zhang 2014, section 2.2.5.

A table of every pose and sensor needs one axis for places and one for directions only: a sensor at the angle beta of a
robot that looks along theta reads r(x, y, theta + beta). Values are uint16 steps of `unit_m`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pfcli.core.grid.raycast import cast, cast_many, clearance
from pfcli.core.jit import inline_kernel, kernel
from pfcli.core.sensor.likelihood_field import grid_frame
from pfcli.core.threads import spread

NONE, UNKNOWN = 65535, 65534
"""Entries of rays that meet nothing within the table's range, and of those that end in unknown cells."""
_TOP = 65533


class RangeTable(NamedTuple):
    """ranges: uint16 (k, bins), a row per free cell; row: int32 (rows, cols), the row that serves a cell, -1 where none
    does; centre: float32 (k, 2), x, y of each row's cell centre in cells; unit_m: metres per step; range_m: the longest
    ray; frame: (6,) from map coordinates to cells; yaw_rad of the grid."""

    ranges: NDArray[np.uint16]
    row: NDArray[np.int32]
    centre: NDArray[np.float32]
    unit_m: float
    range_m: float
    frame: NDArray[np.float64]
    yaw_rad: float


NEAR_CELLS = 6.0
"""A sensor in a cell that is not free (maps have such cells where robots drive) is served by a free one so near."""


def nearest_free(cells: NDArray[np.int8]) -> NDArray[np.int32]:
    """Flat index of the free cell nearest to each cell (rows, columns): itself where it is free, -1 where none is within
    NEAR_CELLS."""
    free = cells == 0
    if not free.any():
        return np.full(cells.shape, -1, np.int32)
    away, (rows, cols) = ndimage.distance_transform_edt(~free, return_indices=True)
    return np.where(away <= NEAR_CELLS, rows * cells.shape[1] + cols, -1).astype(np.int32)


def bytes_of(cells: NDArray[np.int8], bins: int) -> int:
    """Size (bytes) of the table of a map, cells (rows, columns)."""
    return int((cells == 0).sum()) * bins * 2 + cells.size * 4


def build(
    cells: NDArray[np.int8],
    resolution_m: float,
    origin: tuple[float, float, float],
    bins: int,
    range_m: float,
    out: NDArray[np.uint16] | None = None,
) -> RangeTable:
    """Cast a ray from every free cell's centre along every direction.

    cells: int8 (rows, cols), 1 occupied, 0 free, -1 unknown; bins: directions per turn; range_m: longest ray;
    out: where the ranges go, uint16 (free cells, bins).
    """
    places = np.argwhere(cells == 0)
    ranges = np.empty((places.shape[0], bins), np.uint16) if out is None else out
    turn = 2 * np.pi * np.arange(bins) / bins
    directions = np.column_stack([np.cos(turn), np.sin(turn)])
    room = clearance(cells)
    unit_m = range_m / _TOP
    spread(_build_rows, places.shape[0], places, room, cells, directions, range_m, resolution_m, unit_m, ranges)
    return over(ranges, cells, resolution_m, origin, range_m)


def over(
    ranges: NDArray[np.uint16],
    cells: NDArray[np.int8],
    resolution_m: float,
    origin: tuple[float, float, float],
    range_m: float,
) -> RangeTable:
    """A table of ranges (free cells, bins) in m that are there already."""
    free = (cells == 0).ravel()
    number = np.where(free, np.cumsum(free) - 1, -1).astype(np.int32)
    near = nearest_free(cells)
    row = np.where(near >= 0, number[near], -1).astype(np.int32)
    rows, cols = np.nonzero(cells == 0)
    centre = np.column_stack([cols + 0.5, rows + 0.5]).astype(np.float32)
    frame = grid_frame(resolution_m, origin)
    return RangeTable(
        ranges=ranges,
        row=row,
        centre=centre,
        unit_m=range_m / _TOP,
        range_m=range_m,
        frame=frame,
        yaw_rad=float(origin[2]),
    )


def rows_around(table: RangeTable, xy: NDArray[np.float64]) -> NDArray[np.float32]:
    """(n, bins) range (m) from the cells of places (n, 2), map frame, along every direction of the grid; the table's
    range where nothing is hit, NaN where the map says nothing."""
    out = np.empty((xy.shape[0], table.ranges.shape[1]), np.float32)
    arguments = (
        np.ascontiguousarray(xy, np.float64),
        table.ranges,
        table.row,
        table.frame,
        table.unit_m,
        table.range_m,
    )
    spread(_around_rows, xy.shape[0], *arguments, out)
    return out


@inline_kernel
def row_at(row, gx, gy):
    """What a grid of integers (rows, cols) holds at (gx, gy) in cells, -1 off the grid."""
    ix, iy = int(np.floor(gx)), int(np.floor(gy))
    if ix < 0 or iy < 0 or ix >= row.shape[1] or iy >= row.shape[0]:
        return -1
    return np.int64(row[iy, ix])


@kernel
def _around_rows(low, high, xy, ranges, row, frame, unit_m, range_m, out):
    for i in range(low, high):
        gx = frame[0] * xy[i, 0] + frame[1] * xy[i, 1] + frame[2]
        k = row_at(row, gx, frame[3] * xy[i, 0] + frame[4] * xy[i, 1] + frame[5])
        for b in range(out.shape[1]):
            value = ranges[k, b] if k >= 0 else UNKNOWN
            out[i, b] = np.nan if value == UNKNOWN else range_m if value == NONE else value * unit_m


@kernel
def _build_rows(low, high, places, room, cells, directions, range_m, resolution_m, unit_m, out):
    for i in range(low, high):
        x, y = places[i, 1] + 0.5, places[i, 0] + 0.5
        for k in range(directions.shape[0]):
            r = cast(room, cells, x, y, directions[k, 0], directions[k, 1], range_m / resolution_m)
            if r == np.inf:
                out[i, k] = NONE
            elif r < 0.0:
                out[i, k] = UNKNOWN
            else:
                out[i, k] = np.uint16(min(_TOP, int(r * resolution_m / unit_m + 0.5)))


def deviation(table: RangeTable, cells: NDArray[np.int8], resolution_m: float, rays: int) -> tuple[float, float]:
    """Share of random rays (seed 0) whose entry, moved to where the ray starts, is within one and two cells of the exact
    range; entries and rays without a range are left out."""
    rng = np.random.default_rng(0)
    pick = rng.integers(table.centre.shape[0], size=rays)
    xy = table.centre[pick] + rng.uniform(-0.5, 0.5, (rays, 2))
    turn = rng.random(rays) * 2 * np.pi
    bins = table.ranges.shape[1]
    value = table.ranges[pick, np.rint(turn / (2 * np.pi) * bins).astype(np.int64) % bins]
    exact = cast_many(clearance(cells), cells, xy, turn, table.range_m / resolution_m)
    off = xy - table.centre[pick]
    looked_up = value * table.unit_m / resolution_m - off[:, 0] * np.cos(turn) - off[:, 1] * np.sin(turn)
    ok = (value < UNKNOWN) & np.isfinite(exact) & (exact >= 0.0)
    error = np.abs(looked_up - exact)[ok]
    return float(np.mean(error <= 1.0)), float(np.mean(error <= 2.0))
