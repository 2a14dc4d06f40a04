"""The step between two updates: how far the robot has moved, whether that is far enough, and how uncertain it is."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between
from pfcli.core.motion.odometry import Noise, standard_deviations


class Step(NamedTuple):
    """now: (1, 3) odometry; moved: (3,) step since the last update in its base frame (m, m, rad); way_m: its length;
    far: far enough for an update."""

    now: NDArray[np.float64]
    moved: NDArray[np.float64]
    way_m: float
    far: bool


def step_since(last: NDArray[np.float64], odometry: tuple[float, float, float], params: Any) -> Step:
    """The step from the odometry (1, 3) of the last update. params: of any system, with `update_distance_m` and `_angle_rad`."""
    now = np.array([odometry], np.float64)
    moved = between(last, now)[0]
    way = float(np.hypot(moved[0], moved[1]))
    far = way >= params.update_distance_m or abs(moved[2]) >= params.update_angle_rad
    return Step(now, moved, way, bool(far))


def noise_of(params: Any) -> Noise:
    """The odometry's errors as the core takes them. params: of any system, with the `motion_*` fields."""
    return Noise(
        params.motion_xy_per_m,
        params.motion_xy_per_rad_m,
        params.motion_xy_m,
        params.motion_yaw_per_rad,
        params.motion_yaw_per_m_rad,
        params.motion_yaw_rad,
    )


def step_noise(moved: NDArray[np.float64], params: Any) -> NDArray[np.float64]:
    """(3,) standard deviations of a step (m, m, rad)."""
    return np.asarray(standard_deviations(moved, noise_of(params)))
