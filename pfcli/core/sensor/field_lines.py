"""Lines of a field: how far a point is from the nearest, what that says of a pose, and poses refined on them.

A point of vision that lies on a line, seen from a wrong pose, falls beside all lines. The distance to the nearest line is
looked up (a table over the field), and so is its evidence (a table over distance and range): no transcendental function
is called per point, which is what Zhang 2011 asks of its look-up table. The evidence of a point is log p(point | pose, field)
/ p(point | nowhere): 0 says nothing.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import cholesky3, solve3, wrap
from pfcli.core.jit import inline_kernel, kernel, put, reduction_kernel
from pfcli.core.sensor.likelihood_field import Model, log_ratio
from pfcli.core.threads import rows_of, spread


class Lines(NamedTuple):
    """Middles of the lines: segments (s, 4) as x1, y1, x2, y2 and arcs (a, 5) as x, y, radius, from, to (m, rad, the arc
    runs counter-clockwise); low, high: corners (2,) of the field."""

    segments: NDArray[np.float64]
    arcs: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


class Table(NamedTuple):
    """Distance to the nearest line in steps of STEP_M, uint8 (rows * cols,), and which line that is; low: corner (2,)."""

    steps: NDArray[np.uint8]
    nearest: NDArray[np.uint8]
    rows: int
    cols: int
    low: NDArray[np.float64]


class Evidence(NamedTuple):
    """Evidence by range and distance: value float32 (RANGES * STEPS,), best (RANGES,) that a point can have, sigma (RANGES,)
    spread at each range (m)."""

    value: NDArray[np.float32]
    best: NDArray[np.float32]
    sigma_m: NDArray[np.float64]


CELL_M, STEP_M, STEPS = 0.02, 0.01, 256
MARGIN_M = 3.0
RANGES, RANGE_STEP_M = 64, 0.25


@inline_kernel
def _offset(segments, arcs, k, x, y):
    """Distance of (x, y) to line k, and the unit vector from its nearest point to (x, y)."""
    if k < segments.shape[0]:
        ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        ex, ey = bx - ax, by - ay
        t = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
        t = min(max(t, 0.0), 1.0)
        fx, fy = ax + t * ex, ay + t * ey
    else:
        j = k - segments.shape[0]
        cx, cy, r = arcs[j, 0], arcs[j, 1], arcs[j, 2]
        span = arcs[j, 4] - arcs[j, 3]
        angle = np.arctan2(y - cy, x - cx) - arcs[j, 3]
        angle -= 2 * np.pi * np.floor(angle / (2 * np.pi))
        if angle > span:
            angle = span if angle - span < 2 * np.pi - angle else 0.0
        fx, fy = cx + r * np.cos(arcs[j, 3] + angle), cy + r * np.sin(arcs[j, 3] + angle)
    dx, dy = x - fx, y - fy
    d = np.sqrt(dx * dx + dy * dy)
    if d > 1e-9:
        return d, dx / d, dy / d
    return 0.0, 0.0, 0.0


@kernel
def nearest_line(segments, arcs, x, y):
    """(distance, index) of the line nearest to (x, y), looking at every one."""
    best, which = np.inf, 0
    for k in range(segments.shape[0] + arcs.shape[0]):
        d, _, _ = _offset(segments, arcs, k, x, y)
        if d < best:
            best, which = d, k
    return best, which


@kernel
def _fill_rows(low, high, segments, arcs, cols, corner, steps, nearest):
    for i in range(low, high):
        y = corner[1] + (i + 0.5) * CELL_M
        for j in range(cols):
            d, k = nearest_line(segments, arcs, corner[0] + (j + 0.5) * CELL_M, y)
            steps[i * cols + j] = min(np.int64(d / STEP_M + 0.5), STEPS - 1)
            nearest[i * cols + j] = k


def build(lines: Lines) -> Table:
    """The table of a field (lines in m, field frame) and MARGIN_M around it: steps and nearest lines (rows * cols,)."""
    low = lines.low - MARGIN_M
    cols, rows = (int(v) for v in np.ceil((lines.high + MARGIN_M - low) / CELL_M))
    steps, nearest = np.empty(rows * cols, np.uint8), np.empty(rows * cols, np.uint8)
    spread(_fill_rows, rows, lines.segments, lines.arcs, cols, low, steps, nearest)
    return Table(steps, nearest, rows, cols, low)


def evidence_table(sigma_m: NDArray[np.float64], hit: float, reach_m: float) -> Evidence:
    """Evidence of points by range. Zhang 2011, eq. (9), beside points that are on no line.

    sigma_m: (RANGES,) spread at the middle of each range; hit: share of points that are on lines (1: eq. (9) alone);
    reach_m: how far from lines other points lie.
    """
    distance = np.asarray(np.arange(STEPS) * STEP_M, np.float64)
    rows = []
    for sigma in sigma_m.tolist():
        if hit < 1.0:
            rows.append(log_ratio(distance, Model(sigma, hit, reach_m)))
        else:
            rows.append(np.log(reach_m / (sigma * np.sqrt(2 * np.pi))) - 0.5 * (distance / sigma) ** 2)
    value = np.array(rows, np.float32)
    return Evidence(value.ravel(), value[:, 0].copy(), sigma_m)


def range_bins(points: NDArray[np.float32]) -> NDArray[np.int32]:
    """Row (b,) of the evidence table of each point (2, b)."""
    return np.asarray(np.minimum(np.hypot(points[0], points[1]) / RANGE_STEP_M, RANGES - 1), np.int32)


@reduction_kernel
def _sum_points(steps, value, rows, cols, gx, gy, c, s, points, shift, at):
    """Cells first, which vectorises, then the loads; beyond the table is as far as its border."""
    for b in range(at.size):
        x = gx + c * points[0, b] - s * points[1, b]
        y = gy + s * points[0, b] + c * points[1, b]
        ix = np.int32(min(max(x, np.float32(0.0)), np.float32(cols - 1)))
        iy = np.int32(min(max(y, np.float32(0.0)), np.float32(rows - 1)))
        at[b] = iy * np.int32(cols) + ix
    total = np.float32(0.0)
    for b in range(at.size):
        total += value[np.uint32(shift[b] + np.int32(steps[np.uint32(at[b])]))]
    return total


@kernel
def _table_rows(low, high, poses, points, table, value, shift, out):
    steps, _, rows, cols, corner = table
    at = np.empty(points.shape[1], np.int32)
    scale = np.float32(1.0 / CELL_M)
    for i in range(low, high):
        gx, gy = np.float32((poses[i, 0] - corner[0]) / CELL_M), np.float32((poses[i, 1] - corner[1]) / CELL_M)
        c, s = np.float32(np.cos(poses[i, 2])) * scale, np.float32(np.sin(poses[i, 2])) * scale
        out[i] = _sum_points(steps, value, rows, cols, gx, gy, c, s, points, shift, at)


@kernel
def _exact_rows(low, high, poses, points, segments, arcs, sigma, hit, reach, out):
    far = (STEPS - 1) * STEP_M
    for i in range(low, high):
        c, s, total = np.cos(poses[i, 2]), np.sin(poses[i, 2]), 0.0
        for b in range(points.shape[1]):
            x = poses[i, 0] + c * points[0, b] - s * points[1, b]
            y = poses[i, 1] + s * points[0, b] + c * points[1, b]
            d = min(nearest_line(segments, arcs, x, y)[0], far) / sigma[b]
            peak = reach / (sigma[b] * np.sqrt(2 * np.pi))
            if hit < 1.0:
                total += np.log(hit * peak * np.exp(-0.5 * d * d) + 1.0 - hit)
            else:
                total += np.log(peak) - 0.5 * d * d
        out[i] = total


def evidence(
    poses: NDArray[np.float64], points: NDArray[np.float32], table: Table, values: Evidence
) -> NDArray[np.float64]:
    """Sum (n,) of the evidence of points (2, b; base frame, m) for each pose (n, 3), by two look-ups per point."""
    out = np.empty(poses.shape[0])
    shift = range_bins(points) * np.int32(STEPS)
    arguments = (poses, points, table, values.value, shift, out)
    spread(_table_rows, poses.shape[0], *arguments, least=rows_of(2 * points.shape[1]))
    return out


def evidence_exact(
    poses: NDArray[np.float64],
    points: NDArray[np.float32],
    lines: Lines,
    sigma_m: NDArray[np.float64],
    hit: float,
    reach_m: float,
) -> NDArray[np.float64]:
    """The same without tables: every line is looked at, every Gaussian computed. sigma_m: (b,) spread of each point."""
    out = np.empty(poses.shape[0])
    spread(_exact_rows, poses.shape[0], poses, points, lines.segments, lines.arcs, sigma_m, hit, reach_m, out)
    return out


class Seen(NamedTuple):
    """Where points were seen around the robot: bool (side, side) cells of _SEEN_M, grown by one cell, in the base frame;
    share of the cells within reach_m of it that are so."""

    cells: NDArray[np.bool_]
    reach_m: float
    share: float


_SEEN_M, _SAMPLE_M = 0.25, 0.25


def seen_from(points_m: NDArray[np.float64], reach_m: float) -> Seen:
    """Cells with a point (b, 2; base frame, m) in them or beside them."""
    half = int(np.ceil(reach_m / _SEEN_M)) + 1
    cells = np.zeros((2 * half, 2 * half), bool)
    at = np.floor(points_m / _SEEN_M).astype(int) + half
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            row, col = np.clip(at + np.array([i, j]), 0, 2 * half - 1).T
            cells[row, col] = True
    middle = (np.arange(2 * half) - half + 0.5) * _SEEN_M
    within = np.hypot(middle[:, None], middle[None, :]) <= reach_m
    return Seen(cells, reach_m, float(np.clip(cells[within].mean(), 0.01, 0.99)))


def samples(lines: Lines) -> NDArray[np.float64]:
    """(k, 2) points on the lines, _SAMPLE_M apart."""
    found = []
    for x1, y1, x2, y2 in lines.segments.tolist():
        t = np.linspace(0.0, 1.0, max(2, round(float(np.hypot(x2 - x1, y2 - y1)) / _SAMPLE_M)))
        found.append(np.column_stack([x1 + t * (x2 - x1), y1 + t * (y2 - y1)]))
    for x, y, r, start, stop in lines.arcs.tolist():
        a = np.linspace(start, stop, max(2, round(r * (stop - start) / _SAMPLE_M)))
        found.append(np.column_stack([x + r * np.cos(a), y + r * np.sin(a)]))
    return np.concatenate(found)


@kernel
def _missed_rows(low, high, poses, marks, cells, reach, hit, gone, out):
    half = cells.shape[0] // 2
    for i in range(low, high):
        c, s, total = np.cos(poses[i, 2]), np.sin(poses[i, 2]), 0.0
        for k in range(marks.shape[0]):
            dx, dy = marks[k, 0] - poses[i, 0], marks[k, 1] - poses[i, 1]
            if dx * dx + dy * dy <= reach * reach:
                row = int(np.floor((c * dx + s * dy) / _SEEN_M)) + half
                col = int(np.floor((c * dy - s * dx) / _SEEN_M)) + half
                total += hit if cells[row, col] else gone
        out[i] = total


def evidence_of_missed(
    poses: NDArray[np.float64], marks: NDArray[np.float64], seen: Seen, miss: float
) -> NDArray[np.float64]:
    """Evidence (n,) of what ought to be seen from each pose (n, 3): samples of the lines (k, 2), each found with
    probability 1 - miss from the right pose, and as often as cells are seen from any other.

    The third part of the observation model that Zhang 2011, section 2.2, takes from Menegatti 2006.
    """
    out = np.empty(poses.shape[0])
    hit, gone = np.log((1.0 - miss) / seen.share), np.log(miss / (1.0 - seen.share))
    spread(_missed_rows, poses.shape[0], poses, marks, seen.cells, seen.reach_m, hit, gone, out)
    return out


_ITERATIONS, _CAUCHY = 10, 2.0
_LOOSE = np.array([1.0, 1.0, 4.0])
"""Information (1 / m^2, 1 / rad^2) that every refinement keeps of its start, so that one straight line is no trap."""


@kernel
def _refine_rows(low, high, poses, points, sigma, table, segments, arcs, worth, hessian):
    _, nearest, rows, cols, corner = table
    h, g, lower, move = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    start = np.empty(3)
    for i in range(low, high):
        put(start, poses[i])
        for _ in range(_ITERATIONS):
            h[:] = 0.0
            for k in range(3):
                h[k, k] = _LOOSE[k]
                g[k] = _LOOSE[k] * (poses[i, k] - start[k])
            c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
            for b in range(points.shape[1]):
                ox, oy = c * points[0, b] - s * points[1, b], s * points[0, b] + c * points[1, b]
                x, y = poses[i, 0] + ox, poses[i, 1] + oy
                col, row = int((x - corner[0]) / CELL_M), int((y - corner[1]) / CELL_M)
                if not (0 <= col < cols and 0 <= row < rows):
                    continue
                e, nx, ny = _offset(segments, arcs, nearest[row * cols + col], x, y)
                u = e / (_CAUCHY * sigma[b])
                w = worth / (sigma[b] * sigma[b] * (1.0 + u * u))
                j2 = ny * ox - nx * oy
                h[0, 0] += w * nx * nx
                h[0, 1] += w * nx * ny
                h[0, 2] += w * nx * j2
                h[1, 1] += w * ny * ny
                h[1, 2] += w * ny * j2
                h[2, 2] += w * j2 * j2
                g[0] += w * nx * e
                g[1] += w * ny * e
                g[2] += w * j2 * e
            h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
            cholesky3(h, lower)
            solve3(lower, g, move)
            for k in range(3):
                poses[i, k] -= move[k]
            if abs(move[0]) + abs(move[1]) + abs(move[2]) < 1e-4:
                break
        poses[i, 2] = wrap(poses[i, 2])
        put(hessian[i], h)


def refine(
    poses: NDArray[np.float64],
    points: NDArray[np.float32],
    sigma_m: NDArray[np.float64],
    table: Table,
    lines: Lines,
    worth: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses (k, 3) moved to where the points lie on lines, and the Hessian (k, 3, 3) of the error there.

    Gauss-Newton on the distance field with Cauchy weights; the idea of Lauer 2006 (LNAI 4020), whose shape of the error
    is its certainty. sigma_m: (b,) spread of each point; worth: of a point, less than 1 where their errors go together.
    """
    out, hessian = poses.copy(), np.empty((poses.shape[0], 3, 3))
    spread(_refine_rows, out.shape[0], out, points, sigma_m, table, lines.segments, lines.arcs, worth, hessian)
    return out, hessian
