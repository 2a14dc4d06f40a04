"""Odometry as a motion prior: how uncertain a step is."""

from typing import NamedTuple

import numpy as np

from pfcli.core.jit import kernel


class Noise(NamedTuple):
    """Standard deviations of a step: per metre driven, per radian turned, and at rest."""

    xy_per_m: float
    xy_per_rad_m: float
    xy_m: float
    yaw_per_rad: float
    yaw_per_m_rad: float
    yaw_rad: float


@kernel
def information(step, noise):  # type: ignore[no-untyped-def]
    """Information matrix (3, 3) of a step (dx, dy, dyaw in the old base frame, m and rad)."""
    d, a = np.hypot(step[0], step[1]), abs(step[2])
    xy = noise.xy_per_m * d + noise.xy_per_rad_m * a + noise.xy_m
    yaw = noise.yaw_per_rad * a + noise.yaw_per_m_rad * d + noise.yaw_rad
    out = np.zeros((3, 3))
    out[0, 0] = out[1, 1] = 1.0 / (xy * xy)
    out[2, 2] = 1.0 / (yaw * yaw)
    return out
