"""Statistics of errors that stand in order of time."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]


class Spread(NamedTuple):
    """Mean, standard deviation, 95 % quantile and maximum of n errors, and a 95 % block bootstrap interval of the mean."""

    n: int
    mean: float
    sd: float
    q95: float
    max: float
    low: float
    high: float


def spread(errors: _Array, seed: int = 0) -> Spread:
    """Statistics of errors (n,) in order of time, in their own unit; the bootstrap draws blocks, since neighbours err alike."""
    if errors.size == 0:
        return Spread(0, *[float("nan")] * 6)
    low, high = block_bootstrap(errors, seed)
    return Spread(
        errors.size,
        float(errors.mean()),
        float(errors.std()),
        float(np.quantile(errors, 0.95)),
        float(errors.max()),
        low,
        high,
    )


def block_bootstrap(errors: _Array, seed: int = 0, rounds: int = 1000) -> tuple[float, float]:
    """95 % interval of the mean by the circular block bootstrap (Politis and Romano 1992), block length n^(1/2)."""
    n = errors.size
    block = max(1, round(n**0.5))
    rng = np.random.default_rng(seed)
    starts = rng.integers(0, n, (rounds, -(-n // block)))
    picks = (starts[:, :, None] + np.arange(block)).reshape(rounds, -1)[:, :n] % n
    low, high = np.quantile(errors[picks].mean(axis=1), [0.025, 0.975])
    return float(low), float(high)
