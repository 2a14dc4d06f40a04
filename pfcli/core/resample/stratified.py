"""Stratified resampling: one random pointer in each of M equal strata (Kitagawa 1996)."""

import numpy as np

from pfcli.core.jit import kernel


@kernel
def ancestors(weights, u):
    """Parent of each offspring, in index order. weights: (n,), sum 1; u: (m,) in [0, 1). Returns (m,)."""
    m = u.size
    out = np.empty(m, np.int64)
    total, k = weights[0], 0
    for j in range(m):
        pointer = (j + u[j]) / m
        while pointer >= total and k < weights.size - 1:
            k += 1
            total += weights[k]
        out[j] = k
    return out
