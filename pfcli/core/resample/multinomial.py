"""Multinomial resampling: N independent draws by inversion (Zhang 2014, section 2.2.3; Gordon 1993)."""

import numpy as np

from pfcli.core.jit import kernel


@kernel
def ancestors(weights, u):
    """Parent of each offspring. weights: (n,), sum 1; u: (m,) in [0, 1), any order. Returns (m,) in ascending order."""
    m = u.size
    out = np.empty(m, np.int64)
    total, k = weights[0], 0
    for j, pointer in enumerate(np.sort(u)):
        while pointer >= total and k < weights.size - 1:
            k += 1
            total += weights[k]
        out[j] = k
    return out
