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
def standard_deviations(step, noise):  # type: ignore[no-untyped-def]
    """(3,) standard deviations of a step: along and across (m), heading (rad)."""
    d, a = np.hypot(step[0], step[1]), abs(step[2])
    out = np.empty(3)
    out[0] = out[1] = noise.xy_per_m * d + noise.xy_per_rad_m * a + noise.xy_m
    out[2] = noise.yaw_per_rad * a + noise.yaw_per_m_rad * d + noise.yaw_rad
    return out


@kernel
def information(step, noise):  # type: ignore[no-untyped-def]
    """Information matrix (3, 3) of a step (dx, dy, dyaw in the old base frame, m and rad)."""
    sd = standard_deviations(step, noise)
    out = np.zeros((3, 3))
    for k in range(3):
        out[k, k] = 1.0 / (sd[k] * sd[k])
    return out
