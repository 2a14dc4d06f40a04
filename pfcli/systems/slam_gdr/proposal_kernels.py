"""Kernels that only this paper needs."""

import numpy as np

from pfcli.core.geometry import cholesky3, wrap
from pfcli.core.jit import kernel


@kernel
def sample_proposal(mode, information, scale, z):
    """Draw each pose from N(mode, scale^2 information^-1); Grisetti 2007, section IV-B, on the Laplace approximation.

    mode: (n, 3); information: (n, 3, 3), positive definite; z: (n, 3) standard normal.
    Returns (poses (n, 3), log sqrt det covariance (n,), position standard deviation (n,)).
    """
    n = mode.shape[0]
    poses, half_log_det, spread, low = np.empty((n, 3)), np.empty(n), np.empty(n), np.zeros((3, 3))
    for i in range(n):
        half_log_det[i] = -0.5 * cholesky3(information[i], low)
        d2 = z[i, 2] / low[2, 2]
        d1 = (z[i, 1] - low[2, 1] * d2) / low[1, 1]
        d0 = (z[i, 0] - low[1, 0] * d1 - low[2, 0] * d2) / low[0, 0]
        poses[i, 0] = mode[i, 0] + scale * d0
        poses[i, 1] = mode[i, 1] + scale * d1
        poses[i, 2] = wrap(mode[i, 2] + scale * d2)
        spread[i] = np.sqrt(0.5 / (low[0, 0] * low[0, 0]) + 0.5 / (low[1, 1] * low[1, 1]))
    return poses, half_log_det, spread


@kernel
def trace(parents, best):
    """Particle index at every update along the ancestry of `best`; parents: (updates, n), from after to before."""
    out = np.empty(parents.shape[0], np.int64)
    k = best
    for t in range(parents.shape[0] - 1, -1, -1):
        out[t] = k
        k = parents[t, k]
    return out


@kernel
def coalesced(parents):
    """How many updates all particles of the end share; parents: (updates, n)."""
    n = parents.shape[1]
    alive = np.arange(n)
    for t in range(parents.shape[0] - 1, -1, -1):
        same = True
        for k in range(1, n):
            if alive[k] != alive[0]:
                same = False
                break
        if same and n > 1:
            return t + 1
        for k in range(n):
            alive[k] = parents[t, alive[k]]
    return 0


@kernel
def covariance(poses):
    """Covariance (3, 3) of equally weighted poses (n, 3), headings seen from the first one."""
    n = poses.shape[0]
    mean, out, offsets = np.zeros(3), np.zeros((3, 3)), np.empty((n, 3))
    for i in range(n):
        offsets[i, 0], offsets[i, 1] = poses[i, 0] - poses[0, 0], poses[i, 1] - poses[0, 1]
        offsets[i, 2] = wrap(poses[i, 2] - poses[0, 2])
        for r in range(3):
            mean[r] += offsets[i, r] / n
    for i in range(n):
        for r in range(3):
            for c in range(3):
                out[r, c] += (offsets[i, r] - mean[r]) * (offsets[i, c] - mean[c]) / n
    return out
