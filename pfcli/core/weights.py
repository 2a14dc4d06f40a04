"""Log weights: normalisation without overflow, effective sample size."""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import kernel
from pfcli.errors import FilterDegenerate


@kernel
def _normalize(log_w):
    top = -np.inf
    for value in log_w:
        if value > top:
            top = value
    weights, total = np.empty(log_w.size), 0.0
    for k in range(log_w.size):
        weights[k] = np.exp(log_w[k] - top)
        total += weights[k]
    return weights / total, top + np.log(total)


def normalize(log_w: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """(weights that sum to 1, log of the sum). Raises FilterDegenerate where no particle has any weight."""
    if not np.isfinite(log_w.max(initial=-np.inf)):
        raise FilterDegenerate("every particle has weight zero: the scan contradicts all hypotheses")
    weights, log_evidence = _normalize(log_w)
    return weights, float(log_evidence)


@kernel
def effective_sample_size(weights):
    """N_eff = 1 / sum w^2 (Zhang 2016, eq. (6))."""
    total = 0.0
    for w in weights:
        total += w * w
    return 1.0 / total
