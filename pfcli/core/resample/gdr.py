"""Gaussian distributed resampling: offspring are dispersed around their parent (Zhang 2016, eqs (7)-(8)).

The paper prints Sigma_i = alpha / w_i with a scalar alpha. A scalar cannot serve m^2 and rad^2 together, and with
normalised weights alpha / w_i grows with N: here Sigma_i = diag(alpha) / (N w_i), so that alpha is the variance at
average weight whatever N is.
"""

import numpy as np

from pfcli.core.jit import kernel


@kernel
def scales(parent_weights, n, cap):
    """Variance factor 1 / (n w) of each offspring, at most `cap`. parent_weights: (m,), normalised before resampling."""
    out = np.empty(parent_weights.size)
    for k in range(out.size):
        out[k] = min(cap, 1.0 / (n * parent_weights[k]))
    return out


@kernel
def disperse(poses, ancestors, factor, sigma, keep_first, z):
    """Draw each offspring around its parent: x_j ~ N(x_i, diag(sigma^2) factor_j).

    poses: (n, 3), already those of the parents; sigma: (3,), m, m, rad; keep_first: the first offspring of every
    parent stays where it is; z: (n, 3) standard normal.
    """
    out = poses.copy()
    parents = 0
    for j in range(ancestors.size):
        parents = max(parents, ancestors[j] + 1)
    seen = np.zeros(parents, np.uint8)
    for j in range(poses.shape[0]):
        if keep_first and not seen[ancestors[j]]:
            seen[ancestors[j]] = 1
            continue
        scale = np.sqrt(factor[j])
        for c in range(3):
            out[j, c] += scale * sigma[c] * z[j, c]
    return out
