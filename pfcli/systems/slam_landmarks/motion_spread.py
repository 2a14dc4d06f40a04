"""How uncertain a step between two observations is."""

import math

import numpy as np
from numpy.typing import NDArray

from pfcli.systems.slam_landmarks.params import Params


def motion_spread(driven: float, turn: float, params: Params) -> NDArray[np.float64]:
    """(4,) along, across (m), of turning (rad), and how far behind (m) its errors turn about. driven: negative backwards.

    Variances grow with way and turn, so that a step is as uncertain as its parts together, however rarely something is seen.
    Turning errors add up along the way: on the average they are about its middle, and across it they leave what parts turned
    at different times.
    """
    way = abs(driven)
    along = math.sqrt(params.motion_xy_m**2 + params.motion_xy_per_root_m**2 * way)
    turning = params.motion_yaw_per_root_m**2 * way + params.motion_yaw_per_root_rad**2 * turn
    yaw = math.sqrt(params.motion_yaw_rad**2 + turning)
    across = math.hypot(params.motion_across_share * along, way * yaw / math.sqrt(12.0))
    return np.array([along, across, yaw, params.motion_pivot_m + driven / 2.0])
