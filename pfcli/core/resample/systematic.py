"""Systematic resampling: N evenly spaced pointers with one random offset (Kitagawa 1996)."""

import numpy as np

from pfcli.core.jit import kernel


@kernel
def ancestors(weights, u):
    """Parent of each offspring, in index order. weights: (n,), sum 1; u: (1,) in [0, 1). |count - n w| < 1."""
    n = weights.size
    out = np.empty(n, np.int64)
    total, k = weights[0], 0
    for j in range(n):
        pointer = (j + u[0]) / n
        while pointer >= total and k < n - 1:
            k += 1
            total += weights[k]
        out[j] = k
    return out


@kernel
def choose(weights, u, wanted):
    """`wanted` indices, any number, in proportion to weights (n,), which need not be normalised. u: in [0, 1)."""
    out = np.empty(wanted, np.int64)
    mass = 0.0
    for w in weights:
        mass += w
    total, k = weights[0], 0
    for j in range(wanted):
        pointer = (j + u) / wanted * mass
        while pointer >= total and k < weights.size - 1:
            k += 1
            total += weights[k]
        out[j] = k
    return out
