"""Resamplers as `--resampler` names them, found by the entry points `pfcli.resamplers`: ours here, anybody's elsewhere.

A resampler is a function `(weights, count, rng) -> ancestors`. weights: (n,), not negative, sum 1; count: how many offspring,
at least 1; rng: where its random numbers come from, and nowhere else. ancestors: int64 (count,), the index of each offspring's
parent. Its expected number of offspring of i is count * weights[i]. The first line of its docstring is its help.
"""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.resample import csw as improved_cumulative_sum
from pfcli.core.resample import multinomial as independent
from pfcli.core.resample import stratified as strata
from pfcli.core.resample.systematic import choose


def systematic(weights: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Evenly spaced pointers with one random offset (Kitagawa 1996)."""
    return np.asarray(choose(weights, rng.random(), count))


def stratified(weights: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """One random pointer in each of equal strata (Kitagawa 1996)."""
    return np.asarray(strata.ancestors(weights, rng.random(count)))


def multinomial(weights: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Independent draws (Gordon 1993)."""
    return np.asarray(independent.ancestors(weights, rng.random(count)))


def csw(weights: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Systematic over weights sorted from the largest (Zhang 2016, section 2.1)."""
    ranked = improved_cumulative_sum.order(weights, "descending")
    return np.asarray(ranked[choose(weights[ranked], rng.random(), count)])
