"""The whole track and all landmarks at once: least squares on what was driven and seen, and draws from its posterior.

Thrun 2006 (GraphSLAM) with Cauchy weights; draws by perturbing every measurement and solving again (Papandreou 2010), which
costs one back substitution each.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from pfcli.core.geometry import between, wrap
from pfcli.core.jit import kernel
from pfcli.core.landmark_store import FIELDS
from pfcli.core.sensor.range_bearing import expected

_ITERATIONS, _CAUCHY, _ENOUGH = 12, 2.5, 1e-4


class Log(NamedTuple):
    """What was driven and seen: step (t - 1, 3) and its sd (t - 1, 3); of each detection: at (d,) pose, of (d,) landmark, z
    (d, 2) range and bearing, sd (d, 2)."""

    step: NDArray[np.float64]
    step_sd: NDArray[np.float64]
    at: NDArray[np.int64]
    of: NDArray[np.int64]
    z: NDArray[np.float64]
    sd: NDArray[np.float64]


class Solution(NamedTuple):
    """track (t, 3), marks (l, 2); draws (n, t, 3) of the track; cost: sum of robust squares."""

    track: NDArray[np.float64]
    marks: NDArray[np.float64]
    draws: NDArray[np.float64]
    cost: float


@kernel
def _rows(track, marks, step, step_sd, at, of, z, sd, value, residual, robust):  # type: ignore[no-untyped-def]
    """Whitened residuals, and Jacobian blocks: of a step by its two poses (3, 6), of a detection by pose and landmark (2, 5)."""
    n = step.shape[0]
    for k in range(n):
        a, b = track[k], track[k + 1]
        c, s = np.cos(a[2]), np.sin(a[2])
        dx, dy = b[0] - a[0], b[1] - a[1]
        e = (c * dx + s * dy - step[k, 0], -s * dx + c * dy - step[k, 1], wrap(b[2] - a[2] - step[k, 2]))
        j = value[k * 18 : k * 18 + 18]
        j[:] = 0.0
        j[0], j[1], j[2], j[3], j[4] = -c, -s, -s * dx + c * dy, c, s
        j[6], j[7], j[8], j[9], j[10] = s, -c, -c * dx - s * dy, -s, c
        j[14], j[17] = -1.0, 1.0
        for r in range(3):
            residual[3 * k + r] = e[r] / step_sd[k, r]
            for m in range(6):
                j[6 * r + m] /= step_sd[k, r]
    out, hv, hf = np.empty(2), np.empty((2, 3)), np.empty((2, 2))
    for k in range(at.size):
        expected(track[at[k]], marks[of[k], 0], marks[of[k], 1], out, hv, hf)
        e0, e1 = (out[0] - z[k, 0]) / sd[k, 0], wrap(out[1] - z[k, 1]) / sd[k, 1]
        w = 1.0
        if robust > 0.0:
            w = np.sqrt(1.0 / (1.0 + (e0 * e0 + e1 * e1) / (robust * robust)))
        residual[3 * n + 2 * k], residual[3 * n + 2 * k + 1] = w * e0, w * e1
        j = value[18 * n + 10 * k : 18 * n + 10 * k + 10]
        for r in range(2):
            for m in range(3):
                j[5 * r + m] = w * hv[r, m] / sd[k, r]
            for m in range(2):
                j[5 * r + 3 + m] = w * hf[r, m] / sd[k, r]


def _pattern(log: Log, fixed: bool) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_], int]:
    """Rows and columns of the Jacobian's entries, which of them count (the first pose is given), and where landmarks start."""
    n, d = log.step.shape[0], log.at.size
    row_s = 3 * np.arange(n)[:, None, None] + np.arange(3)[None, :, None] + np.zeros((1, 1, 6), int)
    col_s = 3 * (np.arange(n)[:, None, None] - 1) + np.arange(6)[None, None, :] + np.zeros((1, 3, 1), int)
    row_d = 3 * n + 2 * np.arange(d)[:, None, None] + np.arange(2)[None, :, None] + np.zeros((1, 1, 5), int)
    pose = 3 * (log.at[:, None] - 1) + np.arange(3)
    mark = np.full((d, 2), -1) if fixed else 3 * n + 2 * log.of[:, None] + np.arange(2)
    col_d = np.broadcast_to(np.concatenate([pose, mark], axis=1)[:, None, :], (d, 2, 5))
    rows, cols = np.concatenate([row_s.ravel(), row_d.ravel()]), np.concatenate([col_s.ravel(), col_d.ravel()])
    return rows, cols, cols >= 0, 3 * n


def solve(
    log: Log,
    track: NDArray[np.float64],
    marks: NDArray[np.float64],
    *,
    fixed: bool = False,
    draws: int = 0,
    rng: np.random.Generator | None = None,
) -> Solution:
    """Most probable track and landmarks near the given ones, and `draws` tracks from their posterior.

    The first pose is kept. fixed: the landmarks are known. Gauss-Newton with a step that is halved while it makes things worse.
    """
    n, d = log.step.shape[0], log.at.size
    rows, cols, counts, base = _pattern(log, fixed)
    size = base + (0 if fixed else 2 * marks.shape[0])
    value, residual = np.empty(18 * n + 10 * d), np.empty(3 * n + 2 * d)
    arguments = log.step, log.step_sd, log.at, log.of, log.z, log.sd, value, residual
    track, marks, best = track.copy(), marks.copy(), np.inf
    for _ in range(_ITERATIONS):
        _rows(track, marks, *arguments, _CAUCHY)
        a = sparse.csc_matrix((value[counts], (rows[counts], cols[counts])), shape=(residual.size, size))
        normal = (a.T @ a + 1e-9 * sparse.identity(size)).tocsc()
        factor = splu(normal, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        move = factor.solve(a.T @ residual)
        best = _cost(track, marks, log)
        for _ in range(6):
            new_track, new_marks = _moved(track, marks, -move, base, fixed)
            if _cost(new_track, new_marks, log) <= best:
                break
            move = move / 2.0
        track, marks = new_track, new_marks
        if np.abs(move).max() < _ENOUGH:
            break
    drawn = np.empty((0, n + 1, 3))
    if draws and rng is not None:
        noise = a.T @ rng.standard_normal((residual.size, draws))
        moves = factor.solve(noise)
        drawn = np.stack([_moved(track, marks, moves[:, k], base, True)[0] for k in range(draws)])
    return Solution(track, marks, drawn, _cost(track, marks, log))


def _moved(
    track: NDArray[np.float64], marks: NDArray[np.float64], move: NDArray[np.float64], base: int, fixed: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    out = track.copy()
    out[1:] += move[:base].reshape(-1, 3)
    out[:, 2] = wrap(out[:, 2])
    return out, marks if fixed else marks + move[base:].reshape(-1, 2)


def _cost(track: NDArray[np.float64], marks: NDArray[np.float64], log: Log) -> float:
    """Sum of squares of the steps and of the Cauchy cost of the detections."""
    off = between(track[:-1], track[1:]) - log.step
    off[:, 2] = wrap(off[:, 2])
    d = marks[log.of] - track[log.at, :2]
    e = np.column_stack(
        [np.hypot(d[:, 0], d[:, 1]) - log.z[:, 0], wrap(np.arctan2(d[:, 1], d[:, 0]) - track[log.at, 2] - log.z[:, 1])]
    )
    squares = np.square(e / log.sd).sum(axis=1)
    return float(np.square(off / log.step_sd).sum() + (_CAUCHY**2 * np.log1p(squares / _CAUCHY**2)).sum())


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


def given_tracks(tracks: NDArray[np.float64], marks: NDArray[np.float64], log: Log) -> NDArray[np.float64]:
    """Landmarks (n, l, FIELDS) of particles whose whole tracks (n, t, 3) are known: mean and covariance from all their
    detections. marks (l, 2): where they are about."""
    out = np.empty((tracks.shape[0], marks.shape[0], FIELDS))
    _given(tracks, marks, log.at, log.of, log.z, log.sd, out)
    return out
