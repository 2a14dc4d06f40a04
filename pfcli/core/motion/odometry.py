"""Odometry as a motion prior: how uncertain a step is, and particles that take it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
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
def standard_deviations(step, noise):
    """(3,) standard deviations of a step: along and across (m), heading (rad)."""
    d, a = np.hypot(step[0], step[1]), abs(step[2])
    out = np.empty(3)
    out[0] = out[1] = noise.xy_per_m * d + noise.xy_per_rad_m * a + noise.xy_m
    out[2] = noise.yaw_per_rad * a + noise.yaw_per_m_rad * d + noise.yaw_rad
    return out


@kernel
def information(step, noise):
    """Information matrix (3, 3) of a step (dx, dy, dyaw in the old base frame, m and rad)."""
    sd = standard_deviations(step, noise)
    out = np.zeros((3, 3))
    for k in range(3):
        out[k, k] = 1.0 / (sd[k] * sd[k])
    return out


@kernel
def _predict_rows(low, high, poses, step, sd, z, out):
    for i in range(low, high):
        dx, dy = step[0] + sd[0] * z[i, 0], step[1] + sd[1] * z[i, 1]
        c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        out[i, 0], out[i, 1] = poses[i, 0] + c * dx - s * dy, poses[i, 1] + s * dx + c * dy
        out[i, 2] = wrap(poses[i, 2] + step[2] + sd[2] * z[i, 2])


def predict(
    poses: NDArray[np.float64], step: NDArray[np.float64], sd: NDArray[np.float64], z: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Each pose (n, 3) after the same noisy step. Thrun 2005, section 5.4; Zhang 2014, eq. (10).

    step, sd: (3,) in the old base frame and its standard deviations (m, m, rad); z: (n, 3) standard normal.
    """
    out = np.empty_like(poses)
    _predict_rows(0, poses.shape[0], poses, step, sd, z, out)
    return out
