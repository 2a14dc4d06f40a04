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
from pfcli.systems.slam_landmarks import sensor_calibration
from pfcli.systems.slam_landmarks.landmark_problem import SLAM, Log, Options, Pattern, entries, pattern_of, rows_of
from pfcli.systems.slam_landmarks.sensor_calibration import PRIOR_SD, detection_errors

_ITERATIONS, _CAUCHY, _ENOUGH = 12, 2.5, 1e-3

_Unknowns = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
_Solver = Callable[[NDArray[np.float64]], NDArray[np.float64]]


class Solution(NamedTuple):
    """track (t, 3), marks (l, 2), calibration (6,); draws (n, t, 3) of the track; cost: sum of robust squares; end_cov (3, 3)
    of the last pose; marks_cov (2 l, 2 l) where it was asked for; calibration_sd (6,): 0 of what was not learnt."""

    track: NDArray[np.float64]
    marks: NDArray[np.float64]
    calibration: NDArray[np.float64]
    draws: NDArray[np.float64]
    cost: float
    end_cov: NDArray[np.float64]
    marks_cov: NDArray[np.float64]
    calibration_sd: NDArray[np.float64]


def solve(
    log: Log,
    track: NDArray[np.float64],
    marks: NDArray[np.float64],
    calibration: NDArray[np.float64] | None = None,
    options: Options = SLAM,
    *,
    draws: int = 0,
    rng: np.random.Generator | None = None,
    spread_of_marks: bool = False,
) -> Solution:
    """Most probable track, landmarks and calibration near the given ones, and `draws` tracks from their posterior, in pairs about
    their mean.

    Gauss-Newton with a step that is halved while it makes things worse.
    """
    pattern, rows = pattern_of(log, marks.shape[0], options), entries(log)
    now = track.copy(), marks.copy(), sensor_calibration.none() if calibration is None else calibration.copy()
    cost = _cost(*now, log)
    for _ in range(_ITERATIONS):
        a, solved = _linear(now, log, pattern, rows)
        slope = a.T @ rows[1]
        slope[pattern.calibration :] += now[2][pattern.learnt] / PRIOR_SD[pattern.learnt] ** 2
        move = solved(slope)
        for _ in range(6):
            new = _moved(now, -move, pattern)
            after = _cost(*new, log)
            if after <= cost:
                break
            move = move / 2.0
        now, cost = new, after
        if np.abs(move).max() < _ENOUGH:
            break
    drawn = np.empty((0, track.shape[0], 3))
    if draws and rng is not None:
        drawn = _draws(now, a, solved, pattern, draws, rng)
    # a first pose that is given is known
    end = _covariance(solved, pattern.size, np.arange(pattern.marks - 3, pattern.marks)) if pattern.marks else None
    where = np.arange(pattern.marks, pattern.calibration) if spread_of_marks else np.empty(0, np.int64)
    sd = sensor_calibration.none()
    if pattern.learnt.size:
        learnt = _covariance(solved, pattern.size, np.arange(pattern.calibration, pattern.size))
        sd[pattern.learnt] = np.sqrt(learnt.diagonal())
    return Solution(
        track=now[0],
        marks=now[1],
        calibration=now[2],
        draws=drawn,
        cost=cost,
        end_cov=np.zeros((3, 3)) if end is None else end,
        marks_cov=_covariance(solved, pattern.size, where),
        calibration_sd=sd,
    )


def _linear(
    now: _Unknowns, log: Log, pattern: Pattern, rows: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> tuple[sparse.csc_matrix, _Solver]:
    """The Jacobian about `now`, and what solves its normal equations."""
    value, residual = rows
    rows_of(*now, tuple(log), value, residual, _CAUCHY)
    a = sparse.csc_matrix((value[pattern.counts], (pattern.rows, pattern.columns)), shape=(residual.size, pattern.size))
    prior = np.full(pattern.size, 1e-9)
    prior[pattern.calibration :] = PRIOR_SD[pattern.learnt] ** -2
    return a, _factored((a.T @ a + sparse.diags(prior)).tocsc(), pattern.calibration)


def _draws(
    now: _Unknowns, a: sparse.csc_matrix, solved: _Solver, pattern: Pattern, count: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """(count, t, 3) tracks from the posterior."""
    half = (count + 1) // 2
    noise = a.T @ rng.standard_normal((a.shape[0], half))
    if pattern.learnt.size:
        noise[pattern.calibration :] += (
            rng.standard_normal((pattern.learnt.size, half)) / PRIOR_SD[pattern.learnt][:, None]
        )
    moves = solved(noise)
    both = np.concatenate([moves, -moves], axis=1)[:, :count]
    return np.stack([_moved(now, both[:, k], pattern)[0] for k in range(count)])


def _covariance(solved: _Solver, size: int, of: NDArray[np.int64]) -> NDArray[np.float64]:
    """(k, k) covariance of these k unknowns."""
    if of.size == 0:
        return np.zeros((0, 0))
    unit = np.zeros((size, of.size))
    unit[of, np.arange(of.size)] = 1.0
    return np.asarray(solved(unit)[of])


def _factored(normal: sparse.csc_matrix, sparse_size: int) -> _Solver:
    """What solves the normal equations. Every step knows the calibration: its columns, full, are eliminated last."""
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


def _moved(now: _Unknowns, move: NDArray[np.float64], pattern: Pattern) -> _Unknowns:
    track, marks, calibration = now
    out = track.copy()
    out[out.shape[0] - pattern.marks // 3 :] += move[: pattern.marks].reshape(-1, 3)
    out[:, 2] = wrap(out[:, 2])
    if pattern.calibration > pattern.marks:
        marks = marks + move[pattern.marks : pattern.calibration].reshape(-1, 2)
    calibration = calibration.copy()
    calibration[pattern.learnt] += move[pattern.calibration :]
    return out, marks, calibration


def squared_errors(
    track: NDArray[np.float64], marks: NDArray[np.float64], calibration: NDArray[np.float64], log: Log
) -> NDArray[np.float64]:
    """(d,) squared errors of the detections, in their standard deviations."""
    errors = detection_errors(track[log.at], marks[log.of], log.z, calibration)
    return np.asarray(np.square(errors / log.sd).sum(axis=1))


def robust(squares: NDArray[np.float64]) -> NDArray[np.float64]:
    """The Cauchy cost of squared errors."""
    return np.asarray(_CAUCHY**2 * np.log1p(squares / _CAUCHY**2))


def _cost(track: NDArray[np.float64], marks: NDArray[np.float64], calibration: NDArray[np.float64], log: Log) -> float:
    """Sum of squares of the steps and of the Cauchy cost of the detections; and of the calibration."""
    off = between(track[:-1], track[1:]) * (1.0 + calibration[[4, 4, 5]]) - log.step
    off[:, 2] = wrap(off[:, 2])
    off[:, 1] -= log.step_sd[:, 3] * off[:, 2]
    driven = float(np.square(off / log.step_sd[:, :3]).sum() + np.square(calibration / PRIOR_SD).sum())
    return driven + float(robust(squared_errors(track, marks, calibration, log)).sum())
