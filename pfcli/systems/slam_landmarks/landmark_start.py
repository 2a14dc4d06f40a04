"""Where a robot is among known landmarks when nothing else is known: from what it saw lately."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate
from pfcli.core.geometry import between, compose, wrap
from pfcli.core.sensor import known_landmarks as detected
from pfcli.systems.slam_landmarks.observation_kernels import UNKNOWN
from pfcli.systems.slam_landmarks.params import Params


class Seen(NamedTuple):
    """An observation before the start: odometry (1, 3), points (m, 2) in the base frame, their spread (m,), columns (m,)."""

    odometry: NDArray[np.float64]
    points_m: NDArray[np.float64]
    sigma_m: NDArray[np.float64]
    column: NDArray[np.int32]


RECENT, _SURE_M, _SURE_RAD = 40, 0.5, 0.2
"""A start among known landmarks comes from the last so many observations, when they tell it as well as this."""
_PLACES, _APART_M, _APART_RAD, _RIVAL = 24, 0.5, 0.5, 6.0
"""So many places are looked at closely; while another one, so far from the best, is less probable by only so many nats, the start
waits: a better place is found by what is seen next."""


def placed(
    recent: tuple[Seen, ...], known: dict[str, tuple[float, float]], params: Params, rng: np.random.Generator
) -> NDArray[np.float64] | None:
    """Particles (n, 3) where what was seen lately wants them; None where it does not tell."""
    places, now = np.array(list(known.values())), recent[-1].odometry
    if recent[-1].column[0] == UNKNOWN:
        recent = recent[-1:]
        if recent[-1].column.size < 3:
            return None
    points, sigma = [], []
    for then in recent:
        moved = between(now, then.odometry)
        ends = compose(moved, np.column_stack([then.points_m, np.zeros(len(then.points_m))]))
        points.append(ends[:, :2])
        sigma.append(np.hypot(then.sigma_m, params.motion_xy_per_root_m * math.sqrt(np.hypot(*moved[0, :2]))))
    columns = np.concatenate([then.column for then in recent]).tolist()
    each = [places[c : c + 1] if c >= 0 else places for c in columns]
    start = np.cumsum([0, *(len(p) for p in each)])
    found = detected.Detections(np.concatenate(points), np.concatenate(each), start, np.concatenate(sigma))
    trial = detected.pair_poses(found, 20_000)
    if trial.shape[0] == 0:
        return None
    fit = detected.evidence(trial, found, 1.0 - params.false_share, 1e4)
    tried = trial[estimate.distinct(trial, np.argsort(-fit, kind="stable"), _PLACES, _APART_M, _APART_RAD)]
    mean, hessian = detected.refine(tried, found)
    refined = detected.evidence(mean, found, 1.0 - params.false_share, 1e4)
    order = np.argsort(-refined, kind="stable")
    mean, hessian, refined = mean[order], hessian[order], refined[order]
    off = mean - mean[0]
    elsewhere = (np.hypot(off[:, 0], off[:, 1]) > _APART_M) | (np.abs(wrap(off[:, 2])) > _APART_RAD)
    if (refined[elsewhere] > refined[0] - _RIVAL).any():
        return None
    cov = np.linalg.inv(hessian[0])
    if cov[0, 0] + cov[1, 1] > _SURE_M**2 or cov[2, 2] > _SURE_RAD**2:
        return None
    return np.asarray(mean[0] + rng.standard_normal((params.particles, 3)) @ np.linalg.cholesky(cov).T)
