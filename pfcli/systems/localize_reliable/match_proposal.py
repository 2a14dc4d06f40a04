"""Particles around the optimum of a scan match, joined by importance sampling. After Akai 2023 (arXiv 2303.00216).

Where the motion noise is set too small, or a wheel slips, no particle stands where the scan fits; the optimum does. It is
found from the mean of the predicted particles: Gauss-Newton on the distance field, each beam weighted by its posterior
of having hit a mapped surface, with the particles' own spread as prior.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate
from pfcli.core.geometry import wrap
from pfcli.core.jit import kernel
from pfcli.core.sensor import class_conditional
from pfcli.core.sensor.class_conditional import Field, Model, Scan

_WIDE_M, _ITERATIONS = 0.2, 12
"""Spread of hits (m) before the first iteration; each takes two thirds of it until it is the model's."""
_SLIP = np.array([0.3, 0.3, 0.15])
"""Spread of the prior of the match (m, m, rad) beside the particles' own: what a slip leaves behind."""
_WIDER = 2.0
"""The samples spread by so many posterior standard deviations, so that no weight explodes."""


class Gaussian(NamedTuple):
    """Mean (3,) and covariance (3, 3) of poses."""

    mean: NDArray[np.float64]
    cov: NDArray[np.float64]

    def log_density(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) log density at poses (n, 3), 1 / (m^2 rad)."""
        off = pose - self.mean
        off[:, 2] = wrap(off[:, 2])
        square = np.einsum("ni,ij,nj->n", off, np.linalg.inv(self.cov), off)
        return np.asarray(-0.5 * (square + np.linalg.slogdet(2 * np.pi * self.cov)[1]))


def gaussian_of(pose: NDArray[np.float64], weights: NDArray[np.float64]) -> Gaussian:
    """Moments of weighted poses (n, 3) that lie in one place; weights (n,) need not add up to 1."""
    found = estimate.whole(pose, weights / weights.sum())
    return Gaussian(found.pose, found.cov + np.diag([1e-6, 1e-6, 1e-7]))


@kernel
def _normal_equations(pose, scan, field, table, per_m, unknown, sigma):
    """Information (3, 3) and gradient (3,) of the beams at a pose, weighted by their posterior of a hit."""
    away, rows, cols, frame, yaw, _ = field
    ends = scan[0]
    scale = np.hypot(frame[0], frame[3])
    c, s = np.cos(pose[2] - yaw), np.sin(pose[2] - yaw)
    gx = frame[0] * pose[0] + frame[1] * pose[1] + frame[2]
    gy = frame[3] * pose[0] + frame[4] * pose[1] + frame[5]
    h, g = np.zeros((3, 3)), np.zeros(3)
    j = np.empty(3)
    for b in range(ends.shape[1]):
        ex, ey = c * ends[0, b] - s * ends[1, b], s * ends[0, b] + c * ends[1, b]
        ix, iy = int(np.floor(gx + scale * ex)), int(np.floor(gy + scale * ey))
        if ix < 1 or iy < 1 or ix >= cols - 1 or iy >= rows - 1:
            continue
        at = iy * cols + ix
        d = away[at]
        hit = table[min(np.int64(d * per_m), table.size - 1)]
        w = (hit - table[table.size - 1]) / (hit + unknown[b]) / (sigma * sigma)
        # a distance changes by no more than the way; beside the map's edge the table would say otherwise
        j[0] = min(max(0.5 * (away[at + 1] - away[at - 1]) * scale, -1.0), 1.0)
        j[1] = min(max(0.5 * (away[at + cols] - away[at - cols]) * scale, -1.0), 1.0)
        j[2] = -ey * j[0] + ex * j[1]
        for k in range(3):
            g[k] += w * j[k] * d
            for m in range(3):
                h[k, m] += w * j[k] * j[m]
    # from the grid's axes to the map's
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turn @ h @ turn.T, turn @ g


def match(around: Gaussian, scan: Scan, field: Field, model: Model, gain: float) -> Gaussian:
    """Posterior of a scan match that starts at the mean of predicted particles. gain: what one beam is worth."""
    prior = np.linalg.inv(around.cov + np.diag(_SLIP**2))
    pose, sigma = around.mean.copy(), _WIDE_M
    information = prior
    for _ in range(_ITERATIONS):
        sigma = max(model.sigma_m, sigma / 1.5)
        wide = model._replace(sigma_m=sigma)
        h, g = _normal_equations(pose, tuple(scan), *class_conditional.packed(scan, field, wide), sigma)
        information = gain * h + prior
        off = pose - around.mean
        off[2] = wrap(off[2])
        pose = pose - np.linalg.solve(information, gain * g + prior @ off)
    return Gaussian(pose, np.linalg.inv(information))


def draw(
    around: Gaussian, found: Gaussian, count: int, slip: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(count, 3) samples around the optimum, and (count,) their log importance: prediction over proposal.

    around: the predicted particles, which a slip of this probability has left; found: what `match` found.
    """
    wide = found._replace(cov=_WIDER**2 * found.cov)
    pose = found.mean + rng.standard_normal((count, 3)) @ np.linalg.cholesky(wide.cov).T
    slipped = around._replace(cov=around.cov + np.diag(_SLIP**2))
    predicted = np.logaddexp(np.log1p(-slip) + around.log_density(pose), np.log(slip) + slipped.log_density(pose))
    return pose, np.asarray(predicted - wide.log_density(pose))
