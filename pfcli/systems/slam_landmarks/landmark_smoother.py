"""The whole track and all landmarks at once: least squares on what was driven and seen, and draws from its posterior.

Thrun 2006 (GraphSLAM) with Cauchy weights; draws by perturbing every measurement and solving again (Papandreou 2010), which
costs one back substitution each.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from pfcli.core.geometry import between, wrap
from pfcli.core.jit import kernel
from pfcli.core.landmark_store import FIELDS
from pfcli.core.sensor.range_bearing import expected

_ITERATIONS, _CAUCHY, _ENOUGH = 12, 2.5, 1e-3

SCALES = ("range_scale", "range_scale_per_rad", "way_scale", "turn_scale")
_SCALES_SD = np.array([0.05, 0.1, 0.05, 0.1])
"""What is known of how far scales, measured by true, are off before anything was seen."""


class Log(NamedTuple):
    """What was driven and seen: step (t - 1, 3) and its sd (t - 1, 4): along, across, of turning, and how far behind (m) its
    errors turn about; of each detection: at (d,) pose, of (d,) landmark, z (d, 2) range and bearing, sd (d, 2)."""

    step: NDArray[np.float64]
    step_sd: NDArray[np.float64]
    at: NDArray[np.int64]
    of: NDArray[np.int64]
    z: NDArray[np.float64]
    sd: NDArray[np.float64]


class Options(NamedTuple):
    """fixed: the landmarks are known and the first pose is not; else the first pose is given. calibrate: scales are unknown."""

    fixed: bool = False
    calibrate: bool = False


SLAM = Options()


class Solution(NamedTuple):
    """track (t, 3), marks (l, 2), scales (4,), see `corrected`; draws (n, t, 3) of the track; cost: sum of robust squares;
    end_cov (3, 3) of the last pose."""

    track: NDArray[np.float64]
    marks: NDArray[np.float64]
    scales: NDArray[np.float64]
    draws: NDArray[np.float64]
    cost: float
    end_cov: NDArray[np.float64]


def no_scales() -> NDArray[np.float64]:
    """All scales are right."""
    return np.zeros(len(SCALES))


def corrected(
    z: NDArray[np.float64], step: NDArray[np.float64], scales: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Detections (d, 2) and steps (..., 3) as they would be with the right scales."""
    ranges = z[:, 0] / (1.0 + scales[0] + scales[1] * z[:, 1])
    return np.column_stack([ranges, z[:, 1]]), step / (1.0 + scales[[2, 2, 3]])


@kernel
def _rows(track, marks, scales, log, value, residual, robust):  # type: ignore[no-untyped-def]
    """Whitened residuals, and Jacobian blocks: of a step by its two poses and the scales of way and turn (3, 8), of a detection
    by pose, landmark and the scales of ranges (2, 7)."""
    step, step_sd, at, of, z, sd = log
    n = step.shape[0]
    for k in range(n):
        a, b = track[k], track[k + 1]
        c, s = np.cos(a[2]), np.sin(a[2])
        dx, dy = b[0] - a[0], b[1] - a[1]
        way, turn, arm = 1.0 + scales[2], 1.0 + scales[3], step_sd[k, 3]
        ahead, aside, turned = c * dx + s * dy, -s * dx + c * dy, wrap(b[2] - a[2])
        e2 = wrap(turn * turned - step[k, 2])
        j = value[k * 24 : k * 24 + 24]
        j[:] = 0.0
        j[0], j[1], j[2], j[3], j[4], j[6] = -way * c, -way * s, way * aside, way * c, way * s, ahead
        j[8], j[9], j[10], j[11], j[12], j[14] = way * s, -way * c, -way * ahead, -way * s, way * c, aside
        # what turned about the axle behind moved the pose across
        j[10] += arm * turn
        j[13], j[15] = -arm * turn, -arm * turned
        j[18], j[21], j[23] = -turn, turn, turned
        e = (way * ahead - step[k, 0], way * aside - step[k, 1] - arm * e2, e2)
        for r in range(3):
            residual[3 * k + r] = e[r] / step_sd[k, r]
            for m in range(8):
                j[8 * r + m] /= step_sd[k, r]
    out, hv, hf = np.empty(2), np.empty((2, 3)), np.empty((2, 2))
    for k in range(at.size):
        expected(track[at[k]], marks[of[k], 0], marks[of[k], 1], out, hv, hf)
        scale = 1.0 + scales[0] + scales[1] * z[k, 1]
        e0, e1 = (scale * out[0] - z[k, 0]) / sd[k, 0], wrap(out[1] - z[k, 1]) / sd[k, 1]
        w = 1.0
        if robust > 0.0:
            w = np.sqrt(1.0 / (1.0 + (e0 * e0 + e1 * e1) / (robust * robust)))
        residual[3 * n + 2 * k], residual[3 * n + 2 * k + 1] = w * e0, w * e1
        j = value[24 * n + 14 * k : 24 * n + 14 * k + 14]
        for r in range(2):
            by = scale if r == 0 else 1.0
            for m in range(3):
                j[7 * r + m] = w * by * hv[r, m] / sd[k, r]
            for m in range(2):
                j[7 * r + 3 + m] = w * by * hf[r, m] / sd[k, r]
        j[5], j[6] = w * out[0] / sd[k, 0], w * out[0] * z[k, 1] / sd[k, 0]
        j[12] = j[13] = 0.0


class _Pattern(NamedTuple):
    """rows and columns of the Jacobian's entries that count, and which of all do; the first column of the landmarks and of the
    scales, and how many columns there are."""

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    counts: NDArray[np.bool_]
    marks: int
    scales: int
    size: int


def _pattern(log: Log, landmarks: int, options: Options) -> _Pattern:
    n, d = log.step.shape[0], log.at.size
    given = 0 if options.fixed else 1
    marks = 3 * (n + 1 - given)
    scales = marks + (0 if options.fixed else 2 * landmarks)
    size = scales + (len(SCALES) if options.calibrate else 0)
    scale = scales + np.arange(4) if options.calibrate else np.full(4, -1)
    step = 3 * (np.arange(n)[:, None] - given) + np.arange(6)
    step = np.concatenate([step, np.tile(scale[2:], (n, 1))], axis=1)
    pose = 3 * (log.at[:, None] - given) + np.arange(3)
    mark = np.full((d, 2), -1) if options.fixed else marks + 2 * log.of[:, None] + np.arange(2)
    seen = np.concatenate([pose, mark, np.tile(scale[:2], (d, 1))], axis=1)
    columns = np.concatenate([np.repeat(step, 3, axis=0).ravel(), np.repeat(seen, 2, axis=0).ravel()])
    rows = np.concatenate([np.repeat(np.arange(3 * n), 8), 3 * n + np.repeat(np.arange(2 * d), 7)])
    counts = columns >= 0
    return _Pattern(rows=rows[counts], columns=columns[counts], counts=counts, marks=marks, scales=scales, size=size)


def solve(
    log: Log,
    track: NDArray[np.float64],
    marks: NDArray[np.float64],
    scales: NDArray[np.float64] | None = None,
    options: Options = SLAM,
    *,
    draws: int = 0,
    rng: np.random.Generator | None = None,
) -> Solution:
    """Most probable track, landmarks and scales near the given ones, and `draws` tracks from their posterior, in pairs about
    their mean.

    Gauss-Newton with a step that is halved while it makes things worse.
    """
    n, d = log.step.shape[0], log.at.size
    pattern = _pattern(log, marks.shape[0], options)
    value, residual = np.empty(24 * n + 14 * d), np.empty(3 * n + 2 * d)
    now = track.copy(), marks.copy(), no_scales() if scales is None else scales.copy()
    prior = np.full(pattern.size, 1e-9)
    if options.calibrate:
        prior[pattern.scales :] = _SCALES_SD**-2
    for _ in range(_ITERATIONS):
        _rows(*now, tuple(log), value, residual, _CAUCHY)
        a = sparse.csc_matrix(
            (value[pattern.counts], (pattern.rows, pattern.columns)), shape=(residual.size, pattern.size)
        )
        solved = _factored((a.T @ a + sparse.diags(prior)).tocsc(), pattern.scales)
        slope = a.T @ residual
        if options.calibrate:
            slope[pattern.scales :] += prior[pattern.scales :] * now[2]
        move = solved(slope)
        best = _cost(*now, log)
        for _ in range(6):
            new = _moved(now, -move, pattern)
            if _cost(*new, log) <= best:
                break
            move = move / 2.0
        now = new
        if np.abs(move).max() < _ENOUGH:
            break
    drawn = np.empty((0, n + 1, 3))
    if draws and rng is not None:
        half = (draws + 1) // 2
        noise = a.T @ rng.standard_normal((residual.size, half))
        if options.calibrate:
            noise[pattern.scales :] += rng.standard_normal((len(SCALES), half)) / _SCALES_SD[:, None]
        moves = solved(noise)
        both = np.concatenate([moves, -moves], axis=1)[:, :draws]
        drawn = np.stack([_moved(now, both[:, k], pattern)[0] for k in range(draws)])
    end_cov = np.zeros((3, 3))
    if pattern.marks:  # a first pose that is given is known
        end, unit = np.arange(pattern.marks - 3, pattern.marks), np.zeros((pattern.size, 3))
        unit[end, range(3)] = 1.0
        end_cov = solved(unit)[end]
    track, marks, scales = now
    return Solution(track=track, marks=marks, scales=scales, draws=drawn, cost=_cost(*now, log), end_cov=end_cov)


def _factored(normal: sparse.csc_matrix, sparse_size: int) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """What solves the normal equations. Every step knows the scales: their columns, full, are eliminated last."""
    k = sparse_size
    factor = splu(normal[:k, :k], permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    if k == normal.shape[0]:
        return lambda rhs: np.asarray(factor.solve(rhs))
    border = normal[:k, k:].toarray()
    through = factor.solve(border)
    rest = normal[k:, k:].toarray() - border.T @ through

    def solved(rhs: NDArray[np.float64]) -> NDArray[np.float64]:
        top = factor.solve(rhs[:k])
        low = np.linalg.solve(rest, rhs[k:] - border.T @ top)
        return np.concatenate([top - through @ low, low])

    return solved


_Unknowns = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def _moved(now: _Unknowns, move: NDArray[np.float64], pattern: _Pattern) -> _Unknowns:
    track, marks, scales = now
    out = track.copy()
    out[out.shape[0] - pattern.marks // 3 :] += move[: pattern.marks].reshape(-1, 3)
    out[:, 2] = wrap(out[:, 2])
    if pattern.scales > pattern.marks:
        marks = marks + move[pattern.marks : pattern.scales].reshape(-1, 2)
    return out, marks, scales + move[pattern.scales :] if pattern.size > pattern.scales else scales


def squared_errors(
    track: NDArray[np.float64], marks: NDArray[np.float64], scales: NDArray[np.float64], log: Log
) -> NDArray[np.float64]:
    """(d,) squared errors of the detections, in their standard deviations."""
    d = marks[log.of] - track[log.at, :2]
    ranges = np.hypot(d[:, 0], d[:, 1]) * (1.0 + scales[0] + scales[1] * log.z[:, 1])
    bearing = np.arctan2(d[:, 1], d[:, 0]) - track[log.at, 2]
    errors = np.column_stack([ranges - log.z[:, 0], wrap(bearing - log.z[:, 1])])
    return np.asarray(np.square(errors / log.sd).sum(axis=1))


def _cost(track: NDArray[np.float64], marks: NDArray[np.float64], scales: NDArray[np.float64], log: Log) -> float:
    """Sum of squares of the steps and of the Cauchy cost of the detections; and of the scales."""
    off = between(track[:-1], track[1:]) * (1.0 + scales[[2, 2, 3]]) - log.step
    off[:, 2] = wrap(off[:, 2])
    off[:, 1] -= log.step_sd[:, 3] * off[:, 2]
    squares = squared_errors(track, marks, scales, log)
    driven = float(np.square(off / log.step_sd[:, :3]).sum() + np.square(scales / _SCALES_SD).sum())
    return driven + float((_CAUCHY**2 * np.log1p(squares / _CAUCHY**2)).sum())


@kernel
def _given(tracks, marks, at, of, z, sd, out):  # type: ignore[no-untyped-def]
    e, hv, hf = np.empty(2), np.empty((2, 3)), np.empty((2, 2))
    info = np.empty((marks.shape[0], 6))
    for i in range(tracks.shape[0]):
        info[:] = 0.0
        for k in range(at.size):
            j = of[k]
            expected(tracks[i, at[k]], marks[j, 0], marks[j, 1], e, hv, hf)
            v = (z[k, 0] - e[0], wrap(z[k, 1] - e[1]))
            w = 1.0 / (1.0 + ((v[0] / sd[k, 0]) ** 2 + (v[1] / sd[k, 1]) ** 2) / 25.0)
            for r in range(2):
                iv = w / (sd[k, r] * sd[k, r])
                info[j, 0] += iv * hf[r, 0] * hf[r, 0]
                info[j, 1] += iv * hf[r, 0] * hf[r, 1]
                info[j, 2] += iv * hf[r, 1] * hf[r, 1]
                info[j, 3] += iv * hf[r, 0] * v[r]
                info[j, 4] += iv * hf[r, 1] * v[r]
            info[j, 5] += 1.0
        for j in range(marks.shape[0]):
            det = info[j, 0] * info[j, 2] - info[j, 1] * info[j, 1]
            out[i, j] = 0.0
            if info[j, 5] == 0.0 or det <= 0.0:
                continue
            p0, p1, p2 = info[j, 2] / det, -info[j, 1] / det, info[j, 0] / det
            out[i, j, 0] = marks[j, 0] + p0 * info[j, 3] + p1 * info[j, 4]
            out[i, j, 1] = marks[j, 1] + p1 * info[j, 3] + p2 * info[j, 4]
            out[i, j, 2], out[i, j, 3], out[i, j, 4] = p0, p1, p2
            out[i, j, 5], out[i, j, 6] = info[j, 5], 20.0


def given_tracks(
    tracks: NDArray[np.float64], marks: NDArray[np.float64], scales: NDArray[np.float64], log: Log
) -> NDArray[np.float64]:
    """Landmarks (n, l, FIELDS) of particles whose whole tracks (n, t, 3) are known: mean and covariance from all their
    detections. marks (l, 2): where they are about."""
    out = np.empty((tracks.shape[0], marks.shape[0], FIELDS))
    z, _ = corrected(log.z, log.step, scales)
    _given(tracks, marks, log.at, log.of, z, log.sd, out)
    return out
