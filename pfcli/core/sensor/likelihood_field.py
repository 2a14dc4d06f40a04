"""Likelihood field whose values are evidence: how much better a pose explains a beam than ignorance does.

Thrun 2005, section 6.4, divided by what a beam would be expected to read in a place of which nothing is known: the
field stores log p(z | x, m) / p(z | unknown place), so that 0 means 'the map says nothing', positive 'here', negative
'not here'. Beams that end in unknown cells can be left out.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.distance import distance_m
from pfcli.core.jit import inline_kernel, kernel
from pfcli.core.sensor.end_cells import cells_of, look_up, place
from pfcli.core.threads import rows_of, spread


class Model(NamedTuple):
    """sigma_m: spread of a hit; z_hit: share of beams that end at mapped surfaces; reach_m: how far a beam reads
    in a place of which nothing is known (the scale that makes densities comparable)."""

    sigma_m: float
    z_hit: float
    reach_m: float


LEVELS = 4
"""Fields with 1, 2, 4 and 8 times the spread: distant beams swing wide with the heading, and blind poses are far off."""

UNKNOWN = 1e6
_JUDGED = np.float32(1e5)
_BLOCK = 256


class Field(NamedTuple):
    """table: float32 (LEVELS * (rows + 2) * (cols + 2),), one field after the other, the spread doubled from each to the
    next, with a border around the map, UNKNOWN where beams are left out; rows, cols: with the border;
    frame: (6,) from map coordinates to cells of the table: m00, m01, tx, m10, m11, ty; yaw of the grid (rad);
    top: (LEVELS,), the highest value of each field."""

    table: NDArray[np.float32]
    rows: int
    cols: int
    frame: NDArray[np.float64]
    yaw_rad: float
    top: NDArray[np.float64]


def grid_frame(resolution_m: float, origin: tuple[float, float, float], border: int = 0) -> NDArray[np.float64]:
    """Affine map (6,) from map coordinates (m) to cells, for origins of any heading."""
    x, y, yaw = origin
    c, s = np.cos(yaw) / resolution_m, np.sin(yaw) / resolution_m
    return np.array([c, s, border - c * x - s * y, -s, c, border + s * x - c * y])


def log_ratio(distance_m: NDArray[np.float64], model: Model, level: int | NDArray[np.int32] = 0) -> NDArray[np.float64]:
    """Evidence (nats, shape of `distance_m`) of a beam that ends so far from a mapped surface (m), with the spread of a level."""
    sigma = model.sigma_m * 2.0**level
    peak = model.reach_m / (sigma * np.sqrt(2 * np.pi))
    ratio = model.z_hit * peak * np.exp(-0.5 * (distance_m / sigma) ** 2) + (1.0 - model.z_hit)
    return np.asarray(np.log(ratio))


def build(
    cells: NDArray[np.int8], resolution_m: float, origin: tuple[float, float, float], model: Model, *, unknown: bool
) -> Field:
    """Field of a map. cells: int8 (rows, cols), 1 occupied, 0 free, -1 unknown.

    unknown: beams that end in unknown cells, off the walls, are left out; else they are judged like any other.
    """
    distance = distance_m(cells == 1, resolution_m)
    beyond = UNKNOWN if unknown else np.log(1.0 - model.z_hit)
    table = np.full((LEVELS, cells.shape[0] + 2, cells.shape[1] + 2), beyond, np.float32)
    for level in range(LEVELS):
        value = log_ratio(distance, model, level)
        if unknown:
            value[(cells == -1) & (value < 0.0)] = UNKNOWN
        table[level, 1:-1, 1:-1] = value
    _, rows, cols = table.shape
    top = log_ratio(np.zeros(LEVELS), model, np.arange(LEVELS, dtype=np.int32))
    return Field(
        table=table.ravel(),
        rows=rows,
        cols=cols,
        frame=grid_frame(resolution_m, origin, 1),
        yaw_rad=float(origin[2]),
        top=top,
    )


def levels_of(points: NDArray[np.float32], sigma_m: float, yaw_sd_rad: float) -> NDArray[np.int32]:
    """Level (b,) at which the spread covers what a heading error of `yaw_sd_rad` moves each end point (2, b) by."""
    swing = np.maximum(1.0, np.hypot(points[0], points[1]) * yaw_sd_rad / sigma_m)
    return np.asarray(np.minimum(np.floor(np.log2(swing)), LEVELS - 1), np.int32)


@inline_kernel
def _add(found, near, far, least, total, n):
    zero = np.float32(0.0)
    for i in range(n):
        value = found[i]
        speaks_for = max(least, value - near) if value < _JUDGED else zero
        total[i] += speaks_for if value > zero else min(zero, value - far)


@kernel
def _evidence_rows(low, high, poses, points, table, frame, shape, yaw, shift, base, least, out):
    """Blocks of poses, beam by beam (`end_cells`): in any order of the poses each sum is the same."""
    placed, at, at_least = np.empty((4, _BLOCK), np.float32), np.empty(_BLOCK, np.int32), np.float32(least)
    found, total = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    for first in range(low, high, _BLOCK):
        n = min(_BLOCK, high - first)
        place(poses[first : first + n], frame, yaw, placed)
        total[:n] = 0.0
        for b in range(points.shape[1]):
            cells_of(placed, points[0, b], points[1, b], shape, shift[b], at, n)
            look_up(table, at, found, n)
            _add(found, base[0, b], base[1, b], at_least, total, n)
        for i in range(n):
            out[first + i] = total[i]


def evidence(
    poses: NDArray[np.float64],
    points: NDArray[np.float32],
    field: Field,
    level: NDArray[np.int32] | None = None,
    base: NDArray[np.float32] | None = None,
    least: float = -np.inf,
) -> NDArray[np.float64]:
    """Sum of the evidence of the beams for each pose.

    poses: (n, 3) in the map frame (m, rad); points: float32 (2, b), end points in the base frame (m); level: int32
    (b,), the field of each beam (None: 0); base: float32 (2, b), evidence that each beam has without the map, for a pose
    that explains it (row 0) and for one that does not (row 1); it is subtracted (None: 0); least: what a beam that a pose
    explains counts for at least. Returns (n,).
    """
    if level is None:
        level = np.zeros(points.shape[1], np.int32)
    if base is None:
        base = np.zeros((2, points.shape[1]), np.float32)
    out = np.empty(poses.shape[0])
    shape = (field.rows, field.cols)
    shift = level * np.int32(field.rows * field.cols)
    frame, yaw = field.frame, field.yaw_rad
    arguments = (poses, points, field.table, frame, shape, yaw, shift, base, least, out)
    spread(_evidence_rows, poses.shape[0], *arguments, least=rows_of(points.shape[1]))
    return out


def of_beams(
    pose: NDArray[np.float64], points: NDArray[np.float32], field: Field, level: NDArray[np.int32]
) -> NDArray[np.float32]:
    """(b,) evidence of each beam for one pose (3,); at least UNKNOWN where the map says nothing.

    points: float32 (2, b), end points in the base frame (m); level: int32 (b,), the field of each beam.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + c * points[0] - s * points[1], pose[1] + s * points[0] + c * points[1]
    f = field.frame
    col = np.clip(np.floor(f[0] * x + f[1] * y + f[2]), 0, field.cols - 1).astype(np.int64)
    row = np.clip(np.floor(f[3] * x + f[4] * y + f[5]), 0, field.rows - 1).astype(np.int64)
    return np.asarray(field.table[level * (field.rows * field.cols) + row * field.cols + col])
