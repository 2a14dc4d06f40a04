"""The protection level: an error bound (m) that holds with 99 %. After the integrity monitoring of navigation."""

import math

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import kernel
from pfcli.formats.map_yaml import GridMap

_RISK = 0.01
_CELL_SD = 1.0 / math.sqrt(12.0)
"""Standard deviation of a surface within its cell, in cells: what no particle cloud knows."""
_DIRECTIONS, _HALVINGS = 32, 24


def protection_level_m(cov: NDArray[np.float64], p_success: float, grid: GridMap) -> float:
    """The radius around the estimate in which the robot is with 99 %.

    cov: (3, 3); p_success: of the hypothesis that the estimate stands for. The risk that the hypothesis is wrong leaves
    the rest of the 1 % to the covariance; where it leaves nothing, the bound is the map's diagonal.
    """
    left = _RISK - (1.0 - p_success)
    if left <= 0.0:
        return float(math.hypot(*grid.cells.shape) * grid.resolution_m)
    half, det = (cov[0, 0] + cov[1, 1]) / 2, cov[0, 0] * cov[1, 1] - cov[0, 1] * cov[1, 0]
    apart = math.sqrt(max(0.0, half * half - det))
    cell = (_CELL_SD * grid.resolution_m) ** 2
    return float(radius_of(left, half + apart + cell, max(0.0, half - apart) + cell))


@kernel
def radius_of(risk, large, small):  # type: ignore[no-untyped-def]
    """The distance that a plane normal error of variances large >= small along its axes exceeds with probability `risk`.

    P(|e| > r) is the mean of exp(-r^2 / (2 v)) over the directions, v the variance that belongs to each (whitened polar
    coordinates); r lies between what the smaller variance in all directions says and the larger one.
    """
    low, high = np.sqrt(-2.0 * np.log(risk) * small), np.sqrt(-2.0 * np.log(risk) * large)
    for _ in range(_HALVINGS):
        middle, beyond = (low + high) / 2, 0.0
        for k in range(_DIRECTIONS):
            c = np.cos(np.pi * (k + 0.5) / _DIRECTIONS)
            beyond += np.exp(-middle * middle / (2.0 * (small + (large - small) * c * c)))
        if beyond > risk * _DIRECTIONS:
            low = middle
        else:
            high = middle
    return high
