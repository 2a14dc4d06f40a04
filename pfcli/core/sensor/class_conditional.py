"""Likelihood of a scan whose beams hit either mapped obstacles or unknown ones. Akai 2023, section 3.2.

Each beam is a mixture over its class: p(z | x) = p(known) (z_hit N(D; 0, sigma) + z_rand / r_max) + p(unknown) u(r),
with D the distance of its end point from the nearest mapped surface (likelihood field) or what it reads less or more than
the expected range (beam model), and u an exponential over the range. An unknown obstacle can only stand in front of a
mapped one: u is 0 for a beam that would have to pass through a wall, which a coarse table of expected ranges tells, or the
rays themselves. Densities are per metre, so that neither the map's resolution nor the number of particles changes anything.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.distance import distance_m
from pfcli.core.grid.raycast import cast
from pfcli.core.jit import inline_kernel, kernel
from pfcli.core.sensor import range_table
from pfcli.core.sensor.end_cells import cells_of, look_up, place
from pfcli.core.sensor.likelihood_field import grid_frame
from pfcli.core.sensor.range_beams import Rays, rays_of
from pfcli.core.sensor.range_table import UNKNOWN, RangeTable, row_at
from pfcli.core.threads import rows_of, spread

OFF_MAP = 1e3
"""Distance given to end points that lie off the map."""
_ANYWHERE_M = np.float32(OFF_MAP - 1.0)


class Model(NamedTuple):
    """sigma_m: spread of hits; z_hit, z_rand: shares of hits and of anything among known beams; known: prior of the class;
    rate_per_m: of the exponential of unknown obstacles; range_m: longest reading; mae_top_m: residuals are counted up to
    this; hit_m: nearer to a surface than this counts as a hit in the share of hits; by_rays: residuals from expected ranges
    instead of the likelihood field."""

    sigma_m: float
    z_hit: float
    z_rand: float
    known: float
    rate_per_m: float
    range_m: float
    mae_top_m: float
    hit_m: float
    by_rays: bool = False


class Field(NamedTuple):
    """away: float32 (rows * cols,), distance (m) to the nearest mapped surface, with a border of OFF_MAP; rows, cols;
    frame: (6,) from map coordinates to cells; yaw_rad of the grid; table: expected ranges, of a coarser grid; rays: the map
    made ready for exact ones."""

    away: NDArray[np.float32]
    rows: int
    cols: int
    frame: NDArray[np.float64]
    yaw_rad: float
    table: RangeTable
    rays: Rays


class Scan(NamedTuple):
    """ends: float32 (2, b), end points in the base frame (m); range_m: float32 (b,); turn: float32 (b,), directions in the
    base frame in turns, 0 .. 1; sensor: (2,), its place in the base frame."""

    ends: NDArray[np.float32]
    range_m: NDArray[np.float32]
    turn: NDArray[np.float32]
    sensor: NDArray[np.float64]


def scan_of(points: NDArray[np.float64], sensor: NDArray[np.float64]) -> Scan:
    """A scan from end points (b, 2) and the sensor's place (2,), base frame."""
    away = points - sensor
    turn = np.mod(np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi), 1.0)
    ends = np.ascontiguousarray(points.T, np.float32)
    return Scan(ends, np.hypot(*away.T).astype(np.float32), turn.astype(np.float32), sensor)


class Fit(NamedTuple):
    """Of each pose (n,): log_likelihood (per beam densities multiplied), mae_m: mean residual, counted up to mae_top_m,
    NaN where no beam is on the map; hits: share of the beams that end at a mapped surface; through: share of those that
    would have to pass through one."""

    log_likelihood: NDArray[np.float64]
    mae_m: NDArray[np.float64]
    hits: NDArray[np.float64]
    through: NDArray[np.float64]


_COARSE_M, _COARSE_BINS, _MARGIN_M, _FAR_BEYOND_M, _FAR_BEYOND = 0.1, 120, 0.3, 1.0, 0.15


def build(
    cells: NDArray[np.int8], resolution_m: float, origin: tuple[float, float, float], range_m: float = 30.0
) -> Field:
    """Distances of a map and its expected ranges. cells: int8 (rows, cols), 1 occupied, 0 free, -1 unknown."""
    away = np.full((cells.shape[0] + 2, cells.shape[1] + 2), OFF_MAP, np.float32)
    away[1:-1, 1:-1] = np.minimum(distance_m(cells == 1, resolution_m), OFF_MAP)
    coarse = max(1, round(_COARSE_M / resolution_m))
    table = range_table.build(_coarser(cells, coarse), resolution_m * coarse, origin, _COARSE_BINS, range_m)
    if table.ranges.shape[0] == 0:  # a row that no cell is served by: kernels may read it
        table = table._replace(ranges=np.full((1, _COARSE_BINS), UNKNOWN, np.uint16))
    rows, cols = away.shape
    rays = rays_of(cells, resolution_m, origin, range_m)
    return Field(
        away=away.ravel(),
        rows=rows,
        cols=cols,
        frame=grid_frame(resolution_m, origin, 1),
        yaw_rad=float(origin[2]),
        table=table,
        rays=rays,
    )


def _coarser(cells: NDArray[np.int8], by: int) -> NDArray[np.int8]:
    """A map with by x by cells joined: occupied if one is, else free if one is."""
    rows, cols = -(-cells.shape[0] // by) * by, -(-cells.shape[1] // by) * by
    padded = np.full((rows, cols), -1, np.int8)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    return np.asarray(padded.reshape(rows // by, by, cols // by, by).max(axis=(1, 3)))


@kernel
def unknown_density(range_m, model):
    """(b,) p(unknown) u(r) of beams with ranges (b,), 1/m."""
    out = np.empty(range_m.size)
    whole = 1.0 - np.exp(-model.rate_per_m * model.range_m)
    for b in range(range_m.size):
        out[b] = (1.0 - model.known) * model.rate_per_m * np.exp(-model.rate_per_m * range_m[b]) / whole
    return out


@kernel
def _hit_table(model, step_m, count):
    """p(known) p(z | known) by distance, in steps; the last entry is that of the random term alone."""
    out = np.empty(count, np.float32)
    for k in range(count):
        d = k * step_m / model.sigma_m
        hit = model.z_hit / (model.sigma_m * np.sqrt(2.0 * np.pi)) * np.exp(-0.5 * d * d) if k < count - 1 else 0.0
        out[k] = model.known * (hit + model.z_rand / model.range_m)
    return out


_STEPS_PER_SIGMA, _TABLE = 64, 64 * 6


_BLOCK = 64
"""Poses that are looked up together, beam by beam."""


@inline_kernel
def _through(ranges, first, base, turn_b, range_b, unit_m, low, high, expected, out, n):
    """Of n poses, in which a beam reads beyond a mapped surface: farther than both neighbouring directions of the table, by a
    margin (1), or so far that not even a wall at its end explains it (2).

    first: where the row of each begins in the table, -1 where none serves it; base: its heading in turns, 0 .. 1;
    low, high, expected: (n,) for what is in between.
    """
    bins, flat = np.int32(ranges.shape[1]), ranges.ravel()
    near, far = range_b - np.float32(_MARGIN_M), range_b - np.float32(_FAR_BEYOND_M + _FAR_BEYOND * range_b)
    for i in range(n):
        k = np.int32((base[i] + turn_b) * np.float32(bins))
        k = k - bins if k >= bins else k
        k = k - bins if k >= bins else k
        k = max(k, np.int32(0))  # a heading that is no number
        low[i] = max(first[i], 0) + k
        high[i] = max(first[i], 0) + (k + 1 if k + 1 < bins else 0)
    for i in range(n):
        expected[i] = max(flat[np.uint64(low[i])], flat[np.uint64(high[i])])
    for i in range(n):
        met, away_m = np.int32(expected[i]) < UNKNOWN, np.float32(expected[i]) * unit_m
        found = np.uint8(met & (away_m < near)) + np.uint8(met & (away_m < far))
        out[i] = found if first[i] >= 0 else 1


@inline_kernel
def _by_field(poses, scan, field, distance, through):
    """Distance (b, n) of every end point from the nearest mapped surface, and which beams read beyond one, for n poses."""
    away, rows, cols, frame, yaw, expected = field[0]
    ranges, row, row_frame, unit_m = expected
    ends, range_m, turn, sensor = scan
    n, bins, unit = poses.shape[0], ranges.shape[1], np.float32(unit_m)
    placed = np.empty((4, n), np.float32)
    first, base, at = np.empty(n, np.int64), np.empty(n, np.float32), np.empty(n, np.int32)
    lower, upper, met = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.uint16)
    place(poses, frame, yaw, placed)
    for i in range(n):
        cos, sin = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        sx = poses[i, 0] + cos * sensor[0] - sin * sensor[1]
        sy = poses[i, 1] + sin * sensor[0] + cos * sensor[1]
        k = row_at(
            row,
            row_frame[0] * sx + row_frame[1] * sy + row_frame[2],
            row_frame[3] * sx + row_frame[4] * sy + row_frame[5],
        )
        first[i] = k * bins if k >= 0 else -1
        turned = (poses[i, 2] - yaw) / (2.0 * np.pi)
        base[i] = turned - np.floor(turned)
    for b in range(ends.shape[1]):
        cells_of(placed, ends[0, b], ends[1, b], (rows, cols), np.int32(0), at, n)
        look_up(away, at, distance[b], n)
        _through(ranges, first, base, turn[b], range_m[b], unit, lower, upper, met, through[b], n)


@kernel
def _by_rays(pose, scan, field, distance, through, i):
    """How much every beam reads less than the first mapped surface, or more than its cell is deep, and which read beyond:
    column i of distance and through (b, n)."""
    room, cells, frame, yaw, reach_m = field[1]
    _, range_m, turn, sensor = scan
    cell_m = 1.0 / np.hypot(frame[0], frame[3])
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + c * sensor[0] - s * sensor[1], pose[1] + s * sensor[0] + c * sensor[1]
    gx, gy = frame[0] * x + frame[1] * y + frame[2], frame[3] * x + frame[4] * y + frame[5]
    nowhere = row_at(room, gx, gy) <= 0
    for b in range(turn.size):
        if nowhere:  # in a wall or off the map nothing can be seen
            distance[b, i], through[b, i] = OFF_MAP, 1
            continue
        angle = pose[2] - yaw + 2.0 * np.pi * turn[b]
        expected = cast(room, cells, gx, gy, np.cos(angle), np.sin(angle), reach_m / cell_m) * cell_m
        beyond = range_m[b] - expected
        met = 0.0 <= expected < np.inf
        distance[b, i] = max(-beyond, beyond - cell_m, 0.0) if met else OFF_MAP
        through[b, i] = met and beyond > _MARGIN_M


@kernel
def _residuals(poses, scan, field, by_rays, distance, through):
    """Residuals (b, n) of every beam at n poses (n, 3), and which read beyond a mapped surface."""
    if by_rays:
        for i in range(poses.shape[0]):
            _by_rays(poses[i], scan, field, distance, through, i)
    else:
        _by_field(poses, scan, field, distance, through)


@inline_kernel
def _judge(distance, through, unknown_b, table, steps, hit_m, top_m, at, density, sums, n):
    """Add what one beam says of n poses: its density, whether it is a hit or beyond one, and its residual. One short loop
    for each, all but the look-up of which is done for several poses at once."""
    product, residual, on_map, hits, beyond = sums
    most, none, unknown = np.float32(table.size - 1), table[table.size - 1], np.float32(unknown_b)
    for i in range(n):
        at[i] = np.int32(min(distance[i] * steps, most))
    for i in range(n):
        density[i] = table[np.uint32(at[i])] + unknown
    for i in range(n):
        near = distance[i] <= hit_m
        passes = (through[i] == 2) | ((through[i] == 1) & (not near))
        density[i] = none if passes else density[i]
        hits[i] += np.int32(near & (not passes))
        beyond[i] += np.int32(passes)
    for i in range(n):
        there = distance[i] < _ANYWHERE_M
        residual[i] += min(distance[i], top_m) if there else np.float32(0.0)
        on_map[i] += np.int32(there)
    for i in range(n):
        product[i] *= density[i]


@kernel
def _fit_rows(low, high, poses, scan, unknown, field, table, per_m, model, out):
    beams = scan[0].shape[1]
    distance, through = np.empty((beams, _BLOCK), np.float32), np.empty((beams, _BLOCK), np.uint8)
    at, density, total = np.empty(_BLOCK, np.int32), np.empty(_BLOCK, np.float32), np.empty(_BLOCK)
    product, residual = np.empty(_BLOCK), np.empty(_BLOCK)
    on_map, hits, beyond = np.empty(_BLOCK, np.int32), np.empty(_BLOCK, np.int32), np.empty(_BLOCK, np.int32)
    sums = product, residual, on_map, hits, beyond
    limits = np.float32(per_m), model.hit_m, np.float32(model.mae_top_m)
    for first in range(low, high, _BLOCK):
        n = min(_BLOCK, high - first)
        _residuals(poses[first : first + n], scan, field, model.by_rays, distance, through)
        for i in range(n):
            total[i], product[i], residual[i], on_map[i], hits[i], beyond[i] = 0.0, 1.0, 0.0, 0, 0, 0
        for b in range(beams):
            _judge(distance[b], through[b], unknown[b], table, *limits, at, density, sums, n)
            if b % 8 == 7:
                # one logarithm for eight beams: their product stays within the range of a double
                for i in range(n):
                    total[i] += np.log(product[i])
                    product[i] = 1.0
        for i in range(n):
            out[first + i, 0] = total[i] + np.log(product[i])
            out[first + i, 1] = residual[i] / on_map[i] if on_map[i] else np.nan
            out[first + i, 2], out[first + i, 3] = hits[i] / beams, beyond[i] / beams


def _packed(field: Field) -> tuple[Any, Any]:
    table, rays = field.table, field.rays
    expected = (table.ranges, table.row, table.frame, table.unit_m)
    by_field = (field.away, field.rows, field.cols, field.frame, field.yaw_rad, expected)
    return by_field, (rays.room, rays.cells, rays.frame, rays.yaw_rad, rays.range_m)


def _densities(scan: Scan, model: Model) -> tuple[NDArray[np.float64], NDArray[np.float32], float]:
    """Of unknown obstacles at each beam's range; of known ones by distance, and the steps of that table per metre."""
    step_m = model.sigma_m / _STEPS_PER_SIGMA
    unknown = unknown_density(scan.range_m.astype(np.float64), model)
    return unknown, _hit_table(model, step_m, _TABLE), 1.0 / step_m


def packed(scan: Scan, field: Field, model: Model) -> tuple[Any, NDArray[np.float32], float, NDArray[np.float64]]:
    """For kernels that look beams up in the likelihood field: its cells, the density of a hit by steps of distance, steps
    per metre, and the density (b,) of an unknown obstacle at each beam's range."""
    unknown, table, per_m = _densities(scan, model)
    return _packed(field)[0], table, per_m, unknown


def fit(poses: NDArray[np.float64], scan: Scan, field: Field, model: Model) -> Fit:
    """How a scan fits poses (n, 3)."""
    out = np.empty((poses.shape[0], 4))
    unknown, table, per_m = _densities(scan, model)
    arguments = (poses, tuple(scan), unknown, _packed(field), table, per_m, model)
    spread(_fit_rows, poses.shape[0], *arguments, out, least=rows_of(2 * scan.range_m.size))
    return Fit(out[:, 0], out[:, 1], out[:, 2], out[:, 3])


class Classes(NamedTuple):
    """Of every beam (b,): p_unknown, posterior of the class (eq. (3)); away_m: distance of its end point from the nearest
    mapped surface (by_rays: from the expected range)."""

    p_unknown: NDArray[np.float64]
    away_m: NDArray[np.float64]


@kernel
def _classes(pose, scan, unknown, field, table, per_m, by_rays, posterior, distance):
    beams = scan[0].shape[1]
    found, through = np.empty((beams, 1), np.float32), np.empty((beams, 1), np.uint8)
    _residuals(pose.reshape(1, 3), scan, field, by_rays, found, through)
    for b in range(beams):
        known = table[min(np.int64(found[b, 0] * per_m), table.size - 1)]
        posterior[b], distance[b] = unknown[b] / (known + unknown[b]), found[b, 0]


def classes(pose: NDArray[np.float64], scan: Scan, field: Field, model: Model) -> Classes:
    """Classes of the beams of a scan at a pose (3,). Akai 2023, eq. (3).

    A beam that seems to pass through a wall is an error of the map or of the pose: it is unknown to the map all the same.
    """
    unknown, table, per_m = _densities(scan, model)
    found = Classes(np.empty(scan.range_m.size), np.empty(scan.range_m.size))
    _classes(pose, tuple(scan), unknown, _packed(field), table, per_m, model.by_rays, *found)
    return found
