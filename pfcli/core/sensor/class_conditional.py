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
from pfcli.core.sensor.likelihood_field import grid_frame
from pfcli.core.sensor.range_beams import Rays, rays_of
from pfcli.core.sensor.range_table import UNKNOWN, RangeTable, row_at
from pfcli.core.threads import rows_of, spread

OFF_MAP = 1e3
"""Distance given to end points that lie off the map."""


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
    rows, cols = away.shape
    rays = rays_of(cells, resolution_m, origin, range_m)
    return Field(away.ravel(), rows, cols, grid_frame(resolution_m, origin, 1), float(origin[2]), table, rays)


def _coarser(cells: NDArray[np.int8], by: int) -> NDArray[np.int8]:
    """A map with by x by cells joined: occupied if one is, else free if one is."""
    rows, cols = -(-cells.shape[0] // by) * by, -(-cells.shape[1] // by) * by
    padded = np.full((rows, cols), -1, np.int8)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    return np.asarray(padded.reshape(rows // by, by, cols // by, by).max(axis=(1, 3)))


@kernel
def unknown_density(range_m, model):  # type: ignore[no-untyped-def]
    """(b,) p(unknown) u(r) of beams with ranges (b,), 1/m."""
    out = np.empty(range_m.size)
    whole = 1.0 - np.exp(-model.rate_per_m * model.range_m)
    for b in range(range_m.size):
        out[b] = (1.0 - model.known) * model.rate_per_m * np.exp(-model.rate_per_m * range_m[b]) / whole
    return out


@kernel
def _hit_table(model, step_m, count):  # type: ignore[no-untyped-def]
    """p(known) p(z | known) by distance, in steps; the last entry is that of the random term alone."""
    out = np.empty(count, np.float32)
    for k in range(count):
        d = k * step_m / model.sigma_m
        hit = model.z_hit / (model.sigma_m * np.sqrt(2.0 * np.pi)) * np.exp(-0.5 * d * d) if k < count - 1 else 0.0
        out[k] = model.known * (hit + model.z_rand / model.range_m)
    return out


_STEPS_PER_SIGMA, _TABLE = 64, 64 * 6


@inline_kernel
def _away(away, rows, cols, gx, gy, c, s, ends, b):  # type: ignore[no-untyped-def]
    """Distance at the end point of beam b for a pose at (gx, gy) cells with turn (c, s) in cells per metre."""
    x, y = gx + c * ends[0, b] - s * ends[1, b], gy + s * ends[0, b] + c * ends[1, b]
    ix = min(max(np.int64(np.floor(x)), 0), cols - 1)
    iy = min(max(np.int64(np.floor(y)), 0), rows - 1)
    return away[iy * cols + ix]


@inline_kernel
def _placed(pose, frame, yaw):  # type: ignore[no-untyped-def]
    """Place of a pose in cells, and its turn as cosine and sine in cells per metre."""
    scale = np.hypot(frame[0], frame[3])
    gx = frame[0] * pose[0] + frame[1] * pose[1] + frame[2]
    gy = frame[3] * pose[0] + frame[4] * pose[1] + frame[5]
    return gx, gy, np.cos(pose[2] - yaw) * scale, np.sin(pose[2] - yaw) * scale


@kernel
def _through(ranges, row, frame, yaw, unit_m, pose, sensor, turn, range_m, out):  # type: ignore[no-untyped-def]
    """Which beams read beyond a mapped surface: farther than both neighbouring directions of the table, by a margin (1),
    or so far that not even a wall at their end explains them (2)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + c * sensor[0] - s * sensor[1], pose[1] + s * sensor[0] + c * sensor[1]
    k = row_at(row, frame[0] * x + frame[1] * y + frame[2], frame[3] * x + frame[4] * y + frame[5])
    bins = ranges.shape[1]
    base = (pose[2] - yaw) / (2.0 * np.pi)
    base -= np.floor(base)
    for b in range(turn.size):
        if k < 0:
            out[b] = 1
            continue
        low = int((base + turn[b]) * bins)
        low = low - bins if low >= bins else low
        low = low - bins if low >= bins else low
        high = low + 1 if low + 1 < bins else 0
        expected = max(ranges[k, low], ranges[k, high])
        beyond = range_m[b] - expected * unit_m if expected < UNKNOWN else 0.0
        out[b] = (beyond > _MARGIN_M) + (beyond > _FAR_BEYOND_M + _FAR_BEYOND * range_m[b])


@kernel
def _by_field(pose, scan, field, distance, through):  # type: ignore[no-untyped-def]
    """Distance of every end point from the nearest mapped surface, and which beams read beyond one."""
    away, rows, cols, frame, yaw, expected = field[0]
    ends, range_m, turn, sensor = scan
    gx, gy, c, s = _placed(pose, frame, yaw)
    _through(expected[0], expected[1], expected[2], yaw, expected[3], pose, sensor, turn, range_m, through)
    for b in range(ends.shape[1]):
        distance[b] = _away(away, rows, cols, gx, gy, c, s, ends, b)


@kernel
def _by_rays(pose, scan, field, distance, through):  # type: ignore[no-untyped-def]
    """How much every beam reads less than the first mapped surface, or more than its cell is deep, and which read beyond."""
    room, cells, frame, yaw, reach_m = field[1]
    _, range_m, turn, sensor = scan
    cell_m = 1.0 / np.hypot(frame[0], frame[3])
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + c * sensor[0] - s * sensor[1], pose[1] + s * sensor[0] + c * sensor[1]
    gx, gy = frame[0] * x + frame[1] * y + frame[2], frame[3] * x + frame[4] * y + frame[5]
    nowhere = row_at(room, gx, gy) <= 0
    for b in range(turn.size):
        if nowhere:  # in a wall or off the map nothing can be seen
            distance[b], through[b] = OFF_MAP, 1
            continue
        angle = pose[2] - yaw + 2.0 * np.pi * turn[b]
        expected = cast(room, cells, gx, gy, np.cos(angle), np.sin(angle), reach_m / cell_m) * cell_m
        beyond = range_m[b] - expected
        met = 0.0 <= expected < np.inf
        distance[b] = max(-beyond, beyond - cell_m, 0.0) if met else OFF_MAP
        through[b] = met and beyond > _MARGIN_M


@kernel
def _residuals(pose, scan, field, by_rays, distance, through):  # type: ignore[no-untyped-def]
    if by_rays:
        _by_rays(pose, scan, field, distance, through)
    else:
        _by_field(pose, scan, field, distance, through)


@kernel
def _fit_rows(low, high, poses, scan, unknown, field, table, per_m, model, out):  # type: ignore[no-untyped-def]
    n = scan[0].shape[1]
    distance, through = np.empty(n, np.float32), np.empty(n, np.uint8)
    for i in range(low, high):
        _residuals(poses[i], scan, field, model.by_rays, distance, through)
        total, product, residual, on_map, hits, beyond = 0.0, 1.0, 0.0, 0, 0, 0
        for b in range(n):
            d = distance[b]
            passes = through[b] == 2 or (through[b] == 1 and d > model.hit_m)
            hit = d <= model.hit_m and not passes
            product *= table[table.size - 1] if passes else table[min(np.int64(d * per_m), table.size - 1)] + unknown[b]
            if b % 8 == 7:
                # one logarithm for eight beams: their product stays within the range of a double
                total += np.log(product)
                product = 1.0
            beyond += passes
            hits += hit
            if d < 999.0:
                residual += min(d, model.mae_top_m)
                on_map += 1
        out[i, 0] = total + np.log(product)
        out[i, 1] = residual / on_map if on_map else np.nan
        out[i, 2], out[i, 3] = hits / n, beyond / n


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
def _classes(pose, scan, unknown, field, table, per_m, by_rays, posterior, distance):  # type: ignore[no-untyped-def]
    n = scan[0].shape[1]
    found, through = np.empty(n, np.float32), np.empty(n, np.uint8)
    _residuals(pose, scan, field, by_rays, found, through)
    for b in range(n):
        known = table[min(np.int64(found[b] * per_m), table.size - 1)]
        posterior[b], distance[b] = unknown[b] / (known + unknown[b]), found[b]


def classes(pose: NDArray[np.float64], scan: Scan, field: Field, model: Model) -> Classes:
    """Classes of the beams of a scan at a pose (3,). Akai 2023, eq. (3).

    A beam that seems to pass through a wall is an error of the map or of the pose: it is unknown to the map all the same.
    """
    unknown, table, per_m = _densities(scan, model)
    found = Classes(np.empty(scan.range_m.size), np.empty(scan.range_m.size))
    _classes(pose, tuple(scan), unknown, _packed(field), table, per_m, model.by_rays, *found)
    return found
