"""The protection level: an error bound (m) that holds with 99 %. After the integrity monitoring of navigation."""

import math

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.grid_map import GridMap
from pfcli.core.jit import kernel

_RISK = 0.01
_SURFACES = 4
"""Surfaces that a scan sees at the least: their places within a cell err independently."""
_DIRECTIONS, _HALVINGS = 32, 24


def surface_variance(away_m: NDArray[np.float64]) -> float:
    """How far the surfaces lie from where the map draws them (m^2), by the residuals (b,) of the beams that hit them (m);
    infinite where none does."""
    return float(np.mean(away_m**2)) if away_m.size else math.inf


def protection_level_m(cov: NDArray[np.float64], p_success: float, grid: GridMap, surface_m2: float) -> float:
    """The radius around the estimate in which the robot is with 99 %.

    cov: (3, 3); p_success: of the hypothesis that the estimate stands for; surface_m2: `surface_variance`, which no particle
    cloud knows, and which is a fourth of a cell's at the least. The risk that the hypothesis is wrong leaves the rest of the
    1 % to the covariance; where it leaves nothing, the bound is the map's diagonal.
    """
    left = _RISK - (1.0 - p_success)
    if left <= 0.0 or not math.isfinite(surface_m2):
        return float(math.hypot(*grid.cells.shape) * grid.resolution_m)
    half, det = (cov[0, 0] + cov[1, 1]) / 2, cov[0, 0] * cov[1, 1] - cov[0, 1] * cov[1, 0]
    apart = math.sqrt(max(0.0, half * half - det))
    surface = max(surface_m2, grid.resolution_m**2 / 12.0 / _SURFACES)
    return float(radius_of(left, half + apart + surface, max(0.0, half - apart) + surface))


@kernel
def radius_of(risk, large, small):
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
