"""Improved cumulative sum of weights: sort by weight, then evenly spaced pointers (Zhang 2016, section 2.1, step 1)."""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.resample import systematic


def order(weights: NDArray[np.float64], sort: str) -> NDArray[np.int64]:
    """The order in which weights are summed: `descending` (ties by index) or `none`."""
    return np.argsort(-weights, kind="stable") if sort == "descending" else np.arange(weights.size)


def ancestors(weights: NDArray[np.float64], u: NDArray[np.float64], sort: str = "descending") -> NDArray[np.int64]:
    """Parent of each offspring. weights: (n,), sum 1; u: (1,) in [0, 1), one random offset."""
    ranked = order(weights, sort)
    found: NDArray[np.int64] = ranked[systematic.ancestors(weights[ranked], u)]
    return found
