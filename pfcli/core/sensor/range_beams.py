"""How well expected ranges explain measured ones, for many poses: from a table or from rays cast on the spot.

The printed model is a Gaussian per beam (Zhang 2014, eq. (13)). The other one is what real scans need: a hit, something
in front of the wall, or anything (Thrun 2005, section 6.3), as evidence against ignorance: log p(z | r) / p(z | unknown
place), so that a beam the map says nothing about counts 0.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.raycast import cast, cast_many, clearance
from pfcli.core.jit import inline_kernel, kernel, reduction_kernel
from pfcli.core.sensor.likelihood_field import grid_frame
from pfcli.core.sensor.range_table import NONE, UNKNOWN, RangeTable, nearest_free, row_at
from pfcli.core.threads import rows_of, spread

_NONE_ANYWHERE = 0.2
"""Share of beams that bring nothing back in a place of which nothing is known."""
_WIDTHS_PER_ROOT = 1.5
"""Widths of expected intervals are told apart by their root, up to 100 sigma."""


class Beams(NamedTuple):
    """One reading. mounts: (g, 3) sensor poses in the base frame; start: (g + 1,) the beams of mount j are those from
    start[j] up to start[j + 1]; turn: float32 (b,), direction in the base frame in turns, 0 .. 1; unit: float32 (2, b),
    the same as a vector; range_m: float32 (b,), infinite where nothing came back."""

    mounts: NDArray[np.float64]
    start: NDArray[np.int64]
    turn: NDArray[np.float32]
    unit: NDArray[np.float32]
    range_m: NDArray[np.float32]


class Model(NamedTuple):
    """What a beam says.

    score: float32 (widths * STEPS + 4,), evidence by how wide the expected interval is (row) and by how far off it a beam
    reads (column, steps of step_m around 0), and four more: where the map knows nothing, a reading where nothing is
    expected, nothing where nothing is, nothing where a hit is. gain: what one beam is worth. missed: evidence of a beam
    whose sensor stands where no robot can. wall_m: how thick walls are drawn in the map: the surface lies anywhere
    between their borders (without it every wall seems too near). widths: 1 expects one range, of the nearest direction;
    more expect anything between the two directions around a beam: along a wall or past a corner these differ by metres,
    and no pose is known so well.
    """

    score: NDArray[np.float32]
    step_m: float
    gain: float
    missed: float
    wall_m: float
    widths: int


STEPS, WIDTHS = 257, 16


def beams_of(
    mounts: NDArray[np.float64], counts: NDArray[np.int64], angles: NDArray[np.float64], range_m: NDArray[np.floating]
) -> Beams:
    """A reading from mounts (g, 3), beams per mount (g,), angles (b,) in each sensor's frame, and ranges (b,)."""
    gamma = angles + np.repeat(mounts[:, 2], counts)
    turn = np.mod(gamma / (2 * np.pi), 1.0)
    return Beams(
        np.ascontiguousarray(mounts, np.float64),
        np.r_[0, np.cumsum(counts)],
        turn.astype(np.float32),
        np.stack([np.cos(gamma), np.sin(gamma)]).astype(np.float32),
        np.asarray(range_m, np.float32),
    )


class Shares(NamedTuple):
    """What becomes of beams: hit the mapped surface, stop before it, bring nothing back; the rest reads anything."""

    hit: float
    short: float
    none: float


def gaussian(sigma_m: float) -> Model:
    """The printed model, eq. (13): -0.5 ((z - r) / sigma)^2; farther than 32 sigma off is as bad as that."""
    step_m = sigma_m / 4
    d = step_m * (np.arange(STEPS) - STEPS // 2)
    worst = -0.5 * 32.0**2
    score = np.r_[-0.5 * (d / sigma_m) ** 2, 0.0, worst, 0.0, worst].astype(np.float32)
    return Model(score=score, step_m=step_m, gain=1.0, missed=worst, wall_m=0.0, widths=1)


def mixture(sigma_m: float, shares: Shares, reach_m: float, gain: float, wall_m: float = 0.0) -> Model:
    """Hit, short, none and anything. reach_m: how far a beam reads in a place of which nothing is known."""
    step_m = sigma_m / 16
    d = step_m * (np.arange(STEPS) - STEPS // 2)
    rest = max(1e-3, 1.0 - shares.hit - shares.short - shares.none)
    width = sigma_m * (np.arange(WIDTHS) / _WIDTHS_PER_ROOT) ** 2
    peak = shares.hit * reach_m / (sigma_m * np.sqrt(2 * np.pi) + width[:, None])
    score = np.log(peak * np.exp(-0.5 * (d / sigma_m) ** 2) + np.where(d < 0, shares.short, 0.0) + rest)
    nothing = np.maximum([1.0 - shares.short - rest, shares.none], 1e-3) / _NONE_ANYWHERE
    special = [0.0, np.log(shares.short + rest), *np.log(nothing)]
    table = np.r_[score.ravel(), special].astype(np.float32)
    return Model(score=table, step_m=step_m, gain=gain, missed=float(score.min()), wall_m=wall_m, widths=WIDTHS)


@inline_kernel
def _slot(d, width, known, expected, z, steps, slots):
    """Place in `score` of a beam that reads z, d off an expected interval of this width; known: whether the map says
    anything of it, expected: whether it says that something is hit; steps: per metre of d and of width."""
    k = np.int32(min(max(d * steps[0] + np.float32(STEPS / 2), np.float32(0.0)), np.float32(STEPS - 1)))
    k += STEPS * np.int32(min(np.sqrt(width * steps[1]), np.float32(WIDTHS - 1)))
    nothing = z == np.inf
    k = slots - 1 if nothing else k
    k = k if expected else (slots - 2 if nothing else slots - 3)
    return k if known else slots - 4


@reduction_kernel
def _row_evidence(ranges, low, high, turn, unit, z, pose, scale, widths, score, steps, at, read):
    """Sum over beams low .. high against one row of the table; pose: turns, cos, sin, dx, dy of the sensor in its cell;
    scale: metres per step of the table, thickness of walls.

    One loop per kind of work, so that all but the look-ups run in vector lanes.
    """
    bins, slots = np.int32(ranges.size), np.int32(score.size)
    whole, base, c, s, dx, dy = np.float32(bins), pose[0], pose[1], pose[2], pose[3], pose[4]
    rounding, beside = np.float32(0.5 if widths == 1 else 0.0), np.int32(0 if widths == 1 else 1)
    for b in range(low, high):
        k = np.int32((base + turn[b]) * whole + rounding)
        k = k - bins if k >= bins else k
        at[b] = k - bins if k >= bins else k
    for b in range(low, high):
        k = at[b] + beside
        read[0, b] = ranges[np.uint32(at[b])]
        read[1, b] = ranges[np.uint32(k if k < bins else 0)]
    for b in range(low, high):
        one, two = np.float32(read[0, b]) * scale[0], np.float32(read[1, b]) * scale[0]
        near, far = min(one, two), max(one, two) + scale[1]
        closer = (c * unit[0, b] - s * unit[1, b]) * dx + (s * unit[0, b] + c * unit[1, b]) * dy
        reads = z[b] + closer
        d = reads - min(max(reads, near), far)
        known = read[0, b] != UNKNOWN and read[1, b] != UNKNOWN
        expected = read[0, b] != NONE or read[1, b] != NONE
        at[b] = _slot(d, far - near, known, expected, z[b], steps, slots)
    total = np.float32(0.0)
    for b in range(low, high):
        total += score[np.uint32(at[b])]
    return total


@inline_kernel
def _sensor(pose, mount, frame, yaw):
    """Place in cells and heading in the grid's frame of a sensor on a robot at `pose`."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + c * mount[0] - s * mount[1], pose[1] + s * mount[0] + c * mount[1]
    return frame[0] * x + frame[1] * y + frame[2], frame[3] * x + frame[4] * y + frame[5], pose[2] - yaw


@kernel
def _table_rows(low, high, poses, beams, table, row, centre, frame, yaw, model, unit_m, out):
    mounts, start, turn, unit, z = beams
    score, steps, gain, missed, wall_m, widths = model
    at, read = np.empty(turn.size, np.int32), np.empty((2, turn.size), np.int32)
    scale = (unit_m, wall_m)
    cell_m = 1.0 / np.hypot(frame[0], frame[3])
    pose = np.empty(5, np.float32)
    for i in range(low, high):
        total = 0.0
        for j in range(mounts.shape[0]):
            gx, gy, heading = _sensor(poses[i], mounts[j], frame, yaw)
            k = row_at(row, gx, gy)
            if k < 0:
                total += missed * (start[j + 1] - start[j])
                continue
            pose[0] = heading / (2 * np.pi) - np.floor(heading / (2 * np.pi))
            pose[1], pose[2] = np.cos(heading), np.sin(heading)
            pose[3], pose[4] = (gx - centre[k, 0]) * cell_m, (gy - centre[k, 1]) * cell_m
            total += _row_evidence(
                table[k], start[j], start[j + 1], turn, unit, z, pose, scale, widths, score, steps, at, read
            )
        out[i] = gain * total


@kernel
def _ray_rows(low, high, poses, beams, room, cells, near, frame, yaw, model, range_m, out):
    mounts, start, _, unit, z = beams
    score, steps, gain, missed, wall_m, _ = model
    cell_m = 1.0 / np.hypot(frame[0], frame[3])
    for i in range(low, high):
        total = 0.0
        for j in range(mounts.shape[0]):
            gx, gy, heading = _sensor(poses[i], mounts[j], frame, yaw)
            k = row_at(near, gx, gy)
            if k < 0:
                total += missed * (start[j + 1] - start[j])
                continue
            iy, ix = k // cells.shape[1], k % cells.shape[1]
            free = ix == int(np.floor(gx)) and iy == int(np.floor(gy))
            x, y = gx if free else ix + 0.5, gy if free else iy + 0.5
            c, s = np.cos(heading), np.sin(heading)
            for b in range(start[j], start[j + 1]):
                ux, uy = c * unit[0, b] - s * unit[1, b], s * unit[0, b] + c * unit[1, b]
                r = cast(room, cells, x, y, ux, uy, range_m / cell_m)
                closer = (gx - x) * ux + (gy - y) * uy
                d = z[b] - np.float32((r - closer) * cell_m if r < np.inf else 0.0)
                d -= min(max(d, np.float32(0.0)), wall_m)
                total += score[_slot(d, wall_m, r >= 0.0, r < np.inf, z[b], steps, np.int32(score.size))]
        out[i] = gain * total


def _packed(model: Model) -> tuple[object, ...]:
    sigma_m = 16 * model.step_m
    steps = (np.float32(1.0 / model.step_m), np.float32(_WIDTHS_PER_ROOT**2 / sigma_m if model.widths > 1 else 0.0))
    return model.score, steps, model.gain, model.missed, np.float32(model.wall_m), model.widths


def from_table(poses: NDArray[np.float64], beams: Beams, table: RangeTable, model: Model) -> NDArray[np.float64]:
    """(n,) evidence of a reading for poses (n, 3), expected ranges looked up (nearest cell and direction; what the
    sensor's place in its cell adds along the beam is added)."""
    out = np.empty(poses.shape[0])
    unit_m = np.float32(table.unit_m)
    places = (table.row, table.centre, table.frame, table.yaw_rad)
    arguments = (poses, tuple(beams), table.ranges, *places, _packed(model), unit_m, out)
    spread(_table_rows, poses.shape[0], *arguments, least=rows_of(5 * beams.turn.size))
    return out


class Rays(NamedTuple):
    """A map to cast rays in: room: `clearance` of cells; cells: int8 (rows, cols); near: the free cell nearest to each;
    range_m; frame, yaw_rad of the grid."""

    room: NDArray[np.uint8]
    cells: NDArray[np.int8]
    near: NDArray[np.int32]
    range_m: float
    frame: NDArray[np.float64]
    yaw_rad: float


def rays_of(cells: NDArray[np.int8], resolution_m: float, origin: tuple[float, float, float], range_m: float) -> Rays:
    """A map made ready for rays. cells: int8 (rows, cols), 1 occupied, 0 free, -1 unknown."""
    return Rays(
        room=clearance(cells),
        cells=cells,
        near=nearest_free(cells),
        range_m=range_m,
        frame=grid_frame(resolution_m, origin),
        yaw_rad=float(origin[2]),
    )


def ranges_from(
    xy: tuple[float, float], directions: NDArray[np.float64], rays: Rays, reach_m: float
) -> NDArray[np.float64]:
    """(b,) distance (m) from a place (map frame) to the first mapped surface in each of the directions (b,) (rad, map frame):
    infinite beyond reach_m, negative where an unknown cell comes first, 0 from within a surface."""
    f, (x, y) = rays.frame, xy
    at = np.array([[f[0] * x + f[1] * y + f[2], f[3] * x + f[4] * y + f[5]]])
    cells_per_m = np.hypot(f[0], f[3])
    places, turn = np.repeat(at, directions.size, 0), directions - rays.yaw_rad
    return np.asarray(cast_many(rays.room, rays.cells, places, turn, reach_m * cells_per_m) / cells_per_m)


def from_rays(poses: NDArray[np.float64], beams: Beams, rays: Rays, model: Model) -> NDArray[np.float64]:
    """(n,) evidence of a reading for poses (n, 3), expected ranges cast on the spot."""
    out = np.empty(poses.shape[0])
    places = (rays.room, rays.cells, rays.near, rays.frame, rays.yaw_rad)
    spread(_ray_rows, poses.shape[0], poses, tuple(beams), *places, _packed(model), rays.range_m, out)
    return out


def misses(poses: NDArray[np.float64], beams: Beams, rays: Rays) -> float:
    """Share of the poses (n, 3) whose first sensor stands in no free cell of the map."""
    return float(_misses(poses, beams.mounts[0], rays.room, rays.frame, rays.yaw_rad) / max(1, poses.shape[0]))


@kernel
def _misses(poses, mount, room, frame, yaw):
    count = 0
    for i in range(poses.shape[0]):
        gx, gy, _ = _sensor(poses[i], mount, frame, yaw)
        count += row_at(room, gx, gy) <= 0
    return count
