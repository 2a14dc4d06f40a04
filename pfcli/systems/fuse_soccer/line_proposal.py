"""Particles proposed where the newest sighting wants them: the predicted hypothesis, refined on the lines.

The error minimisation of Lauer 2006 and of NuBot finds one pose; here its result and the shape of the error there make a
Gaussian from which some particles are drawn beside the predicted ones. All are weighed by the mixture they came from (Veach
1995, the balance heuristic), so that the refinement steers where particles are, not what they say.
"""

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate, gaussians
from pfcli.core.geometry import wrap
from pfcli.core.jit import inline_kernel, kernel
from pfcli.core.sensor import field_lines, known_landmarks
from pfcli.core.weights import normalize
from pfcli.systems.fuse_soccer.field_assets import Assets, View
from pfcli.systems.fuse_soccer.sighting_likelihood import Belief

MODE_M, MODE_RAD = 0.6, 0.5
_LEAST_POINTS = 8
_WIDER = 1.5
_NARROWEST = np.diag([0.005**2, 0.005**2, 0.003**2])


def refined(poses: NDArray[np.float64], view: View, assets: Assets) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses (k, 3) where lines and landmarks want them, and the Hessian (k, 3, 3) of the error there."""
    if view.points.shape[1] == 0 and view.detections is not None:
        return known_landmarks.refine(poses, view.detections)
    mean, hessian = field_lines.refine(poses, view.points, view.sigma_m, assets.table, assets.field.lines, view.worth)
    if view.detections is None:
        return mean, hessian
    pulled, more = known_landmarks.refine(mean, view.detections)
    off = pulled - mean
    off[:, 2] = wrap(off[:, 2])
    both = hessian + more
    return mean + np.linalg.solve(both, more @ off[:, :, None])[:, :, 0], both


def tells(view: View) -> bool:
    """Whether a sighting says where the robot is: some points, or two landmarks."""
    marks = 0 if view.detections is None else view.detections.seen_m.shape[0]
    return view.points.shape[1] >= _LEAST_POINTS or marks >= 2


@kernel
def _mixture(pose, log_own, prior, prior_inverse, drawn, drawn_inverse, log_gain, predicted, share, reach_m, reach_rad):
    """Turn own log weights (n,) into those of a mixture: predicted ones, and `share` around `drawn`.

    log_gain: log of the peak of the drawn Gaussian over that of the prior one; predicted: how many rows are predicted ones.
    """
    for i in range(pose.shape[0]):
        dx, dy, dt = pose[i, 0] - prior[0], pose[i, 1] - prior[1], wrap(pose[i, 2] - prior[2])
        if dx * dx + dy * dy > reach_m * reach_m or abs(dt) > reach_rad:
            # beyond reach nothing is drawn for weight: what was drawn there by chance has none
            log_own[i] = log_own[i] - np.log(1.0 - share) if i < predicted else -np.inf
            continue
        ex, ey, et = pose[i, 0] - drawn[0], pose[i, 1] - drawn[1], wrap(pose[i, 2] - drawn[2])
        ratio = log_gain + 0.5 * (_square(prior_inverse, dx, dy, dt) - _square(drawn_inverse, ex, ey, et))
        log_own[i] -= np.log((1.0 - share) + share * np.exp(min(ratio, 500.0)))


@inline_kernel
def _square(a, x, y, t):
    return (
        a[0, 0] * x * x
        + a[1, 1] * y * y
        + a[2, 2] * t * t
        + 2.0 * (a[0, 1] * x * y + a[0, 2] * x * t + a[1, 2] * y * t)
    )


@kernel
def _fused(prior, prior_cov, refined, hessian):
    """Product of two Gaussians, widened a little, and the squared distance of their means over what both allow."""
    off = refined - prior
    off[2] = wrap(off[2])
    surprise = off @ (np.linalg.inv(prior_cov + np.linalg.inv(hessian)) @ off) / 3.0
    cov = np.linalg.inv(hessian + np.linalg.inv(prior_cov))
    return prior + cov @ (hessian @ off), _WIDER * cov + _NARROWEST, surprise


def beside(
    belief: Belief,
    at: NDArray[np.float64],
    view: View,
    assets: Assets,
    count: int,
    rng: np.random.Generator,
) -> tuple[Belief, float]:
    """The belief with `count` particles more around the refined pose of the hypothesis at `at` (3,), and the surprise.

    The surprise is the squared distance of the refined pose from the predicted one over what both allow, 1 on the average.
    Few points without two landmarks refine nothing.
    """
    if count == 0 or not tells(view):
        return belief, 1.0
    n = belief.pose.shape[0]
    weights, _ = normalize(belief.log_w)
    prior = estimate.around(belief.pose, weights, at, MODE_M, MODE_RAD)
    prior_cov = prior.cov + _NARROWEST
    found, hessian = refined(prior.pose[None], view, assets)
    mean, cov, surprise = _fused(prior.pose, prior_cov, found[0], hessian[0])
    both = np.stack([prior_cov, cov])
    inverse, peak = gaussians.precisions(both)
    drawn = gaussians.draw(mean[None], both[1:], np.zeros(count, np.int64), rng.standard_normal((count, 3)))
    pose = np.concatenate([belief.pose, drawn])
    # what was there keeps its weight; what is new has that of an equal share of the predicted ones
    log_w = np.concatenate([belief.log_w, np.full(count, -np.log(n))])
    gain = float(peak[1] - peak[0] - np.log(max(prior.mass, 1e-9)))
    _mixture(pose, log_w, prior.pose, inverse[0], mean, inverse[1], gain, n, count / (n + count), MODE_M, MODE_RAD)
    odds = np.concatenate([belief.odds, np.full(count, belief.odds[int(np.argmax(weights))])])
    return Belief(pose, log_w, odds), float(surprise)
