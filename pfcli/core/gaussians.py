"""Gaussians over poses: densities of mixtures, and draws."""

import numpy as np

from pfcli.core.geometry import cholesky3, solve3, wrap
from pfcli.core.jit import kernel


@kernel
def log_density(poses, mean, precision, log_norm, weight):
    """Log of a mixture of Gaussians (k) at each pose (n, 3); log_norm (k,): of each one's peak."""
    out = np.empty(poses.shape[0])
    for i in range(poses.shape[0]):
        total = 0.0
        for k in range(mean.shape[0]):
            e0, e1, e2 = poses[i, 0] - mean[k, 0], poses[i, 1] - mean[k, 1], wrap(poses[i, 2] - mean[k, 2])
            p = precision[k]
            q = p[0, 0] * e0 * e0 + p[1, 1] * e1 * e1 + p[2, 2] * e2 * e2
            q += 2.0 * (p[0, 1] * e0 * e1 + p[0, 2] * e0 * e2 + p[1, 2] * e1 * e2)
            total += weight[k] * np.exp(log_norm[k] - 0.5 * q)
        out[i] = np.log(total + 1e-300)
    return out


@kernel
def draw(mean, cov, chosen, z):
    """One draw (n, 3) around the chosen (n,) Gaussians. z: (n, 3) standard normal."""
    out, low = np.empty(z.shape), np.zeros((3, 3))
    last = -1
    for i in range(z.shape[0]):
        k = chosen[i]
        if k != last:
            cholesky3(cov[k], low)
            last = k
        out[i, 0] = mean[k, 0] + low[0, 0] * z[i, 0]
        out[i, 1] = mean[k, 1] + low[1, 0] * z[i, 0] + low[1, 1] * z[i, 1]
        out[i, 2] = wrap(mean[k, 2] + low[2, 0] * z[i, 0] + low[2, 1] * z[i, 1] + low[2, 2] * z[i, 2])
    return out


@kernel
def precisions(cov):
    """Inverse (k, 3, 3) of each covariance, and the log (k,) of each Gaussian's peak."""
    inverse, peak, low, unit = np.empty(cov.shape), np.empty(cov.shape[0]), np.zeros((3, 3)), np.zeros(3)
    for k in range(cov.shape[0]):
        peak[k] = -0.5 * cholesky3(cov[k], low) - 1.5 * np.log(2 * np.pi)
        for c in range(3):  # by columns, which are the rows
            unit[c] = 1.0
            solve3(low, unit, inverse[k, c])
            unit[c] = 0.0
    return inverse, peak
