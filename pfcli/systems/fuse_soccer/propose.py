"""Particles proposed where the newest sighting wants them: the predicted hypothesis, refined on the lines.

The error minimisation of Lauer 2006 and of NuBot finds one pose; here its result and the shape of the error there make a
Gaussian from which some particles are drawn beside the predicted ones. All are weighed by the mixture they came from (Veach
1995, the balance heuristic), so that the refinement steers where particles are, not what they say.
"""

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate
from pfcli.core.sensor import field_lines
from pfcli.core.weights import normalize
from pfcli.systems.fuse_soccer.assets import Assets, View
from pfcli.systems.fuse_soccer.start import draw_peaks, log_density, precisions
from pfcli.systems.fuse_soccer.weigh import Belief

MODE_M, MODE_RAD = 0.6, 0.5
_LEAST_POINTS = 8
_NARROWEST = np.diag([0.005**2, 0.005**2, 0.003**2])


def beside(belief: Belief, view: View, assets: Assets, count: int, rng: np.random.Generator) -> Belief:
    """The belief with `count` particles more around the refined pose of its densest hypothesis; few points refine nothing."""
    if count == 0 or view.points.shape[1] < _LEAST_POINTS:
        return belief
    n = belief.pose.shape[0]
    weights, _ = normalize(belief.log_w)
    prior = estimate.densest(belief.pose, weights, MODE_M, MODE_RAD)
    prior_cov = prior.cov + _NARROWEST
    refined, hessian = field_lines.refine(
        prior.pose[None], view.points, view.sigma_m, assets.table, assets.field.lines, view.worth
    )
    off = refined[0] - prior.pose
    off[2] = np.remainder(off[2] + np.pi, 2 * np.pi) - np.pi
    before, _ = precisions(prior_cov[None])
    cov = np.linalg.inv(hessian[0] + before[0])
    mean = prior.pose + cov @ (hessian[0] @ off)
    wide = 1.5 * cov + _NARROWEST
    drawn = draw_peaks(mean[None], wide[None], np.zeros(count, np.int64), rng.standard_normal((count, 3)))
    pose = np.concatenate([belief.pose, drawn])
    log_prior = _log_gaussian(pose, prior.pose, prior_cov) + np.log(max(prior.mass, 1e-9))
    log_drawn = _log_gaussian(pose, mean, wide)
    inside = estimate.members(pose, prior.pose, MODE_M, MODE_RAD)
    share = count / (n + count)
    # what was there keeps its weight; what is new has that of an equal share of the predicted ones
    log_own = np.concatenate([belief.log_w, np.full(count, np.log(weights.sum() / n))])
    ratio = -np.log((1.0 - share) + share * np.exp(np.minimum(log_drawn - log_prior, 500.0)))
    ratio = np.where(inside, ratio, -np.log(1.0 - share))
    odds = np.concatenate([belief.odds, np.full(count, _odds_of(belief, weights))])
    return Belief(pose, log_own + ratio, odds)


def _log_gaussian(
    poses: NDArray[np.float64], mean: NDArray[np.float64], cov: NDArray[np.float64]
) -> NDArray[np.float64]:
    precision, peak = precisions(cov[None])
    return np.asarray(log_density(poses, mean[None], precision, peak, np.ones(1)))


def _odds_of(belief: Belief, weights: NDArray[np.float64]) -> float:
    """Odds of the heaviest particle: all of one hypothesis share them nearly."""
    return float(belief.odds[int(np.argmax(weights))])
