"""Occupancy grid maps: what every map of a run is, whoever drew it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.events import Pose2


class GridMap(NamedTuple):
    """cells: int8 (rows, cols), row 0 at the bottom: 0 free, 1 occupied, -1 unknown; origin: pose of the lower left corner
    (m, m, rad) in the map frame."""

    cells: NDArray[np.int8]
    resolution_m: float
    origin: Pose2
