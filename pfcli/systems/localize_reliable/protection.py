"""The protection level: an error bound (m) that holds with 99 %. After the integrity monitoring of navigation."""

import math

import numpy as np
from numpy.typing import NDArray

from pfcli.formats.map_yaml import GridMap

_RISK = 0.01
_CELL_SD = 1.0 / math.sqrt(12.0)
"""Standard deviation of a surface within its cell, in cells: what no particle cloud knows."""


def protection_level_m(cov: NDArray[np.float64], p_success: float, grid: GridMap) -> float:
    """The radius around the estimate in which the robot is with 99 %.

    cov: (3, 3); p_success: of the hypothesis that the estimate stands for. The risk that the hypothesis is wrong leaves
    the rest of the 1 % to the covariance; where it leaves nothing, the bound is the map's diagonal.
    """
    left = _RISK - (1.0 - p_success)
    if left <= 0.0:
        return float(math.hypot(*grid.cells.shape) * grid.resolution_m)
    trace, det = cov[0, 0] + cov[1, 1], cov[0, 0] * cov[1, 1] - cov[0, 1] * cov[1, 0]
    largest = trace / 2 + math.sqrt(max(0.0, trace * trace / 4 - det))
    return math.sqrt(-2.0 * math.log(left) * (largest + (_CELL_SD * grid.resolution_m) ** 2))
