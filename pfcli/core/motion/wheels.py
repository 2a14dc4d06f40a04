"""Wheel bases: how the travel of each wheel and the step of the robot belong together, and particles that roll.

A base is its Jacobian J (k, 3): travel of each wheel (m) = J (dx, dy, dyaw), the step in the robot's frame (x ahead, y to
the left). The step of given wheels is the least-squares one; what it leaves over says how far the wheels contradict each other.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
from pfcli.core.jit import kernel

Jacobian = NDArray[np.float64]


def differential(track_m: float) -> Jacobian:
    """Left and right wheel, `track_m` apart; it cannot go sideways."""
    return np.array([[1.0, 0.0, -track_m / 2], [1.0, 0.0, track_m / 2]])


def omni(place_rad: Sequence[float], arm_m: Sequence[float]) -> Jacobian:
    """Omni wheels at the bearings `place_rad` (k,), `arm_m` (k,) from the centre; each drives along the tangent, and
    positive travel turns the robot counter-clockwise."""
    return np.array([[-np.sin(a), np.cos(a), r] for a, r in zip(place_rad, arm_m, strict=True)])


def four_places(phi_rad: float) -> tuple[float, float, float, float]:
    """Bearings of the paper's four wheels (Zhang 2011, eq. (3), with x ahead): rear left, front left, front right, rear right."""
    half = np.pi / 2
    return half + phi_rad, half - phi_rad, phi_rad - half, -phi_rad - half


def mecanum(half_length_m: float, half_width_m: float) -> Jacobian:
    """Mecanum wheels with rollers at 45 degrees, in the order front left, front right, rear left, rear right.

    half_length_m, half_width_m: from the centre to the axles and to the wheels.
    """
    arm = half_length_m + half_width_m
    return np.array([[1.0, -1.0, -arm], [1.0, 1.0, arm], [1.0, 1.0, -arm], [1.0, -1.0, arm]])


def inverse(jacobian: Jacobian) -> NDArray[np.float64]:
    """J+ (3, k), the pseudo-inverse: step of the robot = J+ travel. Zhang 2011, eq. (3), whose factor 1/2 is J+ at 45 degrees.

    Rounded, so that no library's last bit decides a byte of a track.
    """
    return np.asarray(np.round(np.linalg.pinv(jacobian), 12))


def slip(travel_m: NDArray[np.float64], jacobian: Jacobian, back: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k,) travel that no motion of the robot explains, D - J J+ D: zero where all wheels grip. back: J+ (3, k)."""
    return np.asarray(travel_m - jacobian @ (back @ travel_m))


@kernel
def _roll_rows(low, high, poses, step, back, mean, sd, z, out):
    wheels = mean.size
    for i in range(low, high):
        dx, dy, dt = step[0], step[1], step[2]
        for k in range(wheels):
            error = mean[k] + sd[k] * z[i, k]
            dx += back[0, k] * error
            dy += back[1, k] * error
            dt += back[2, k] * error
        c, s = np.cos(poses[i, 2] + dt / 2), np.sin(poses[i, 2] + dt / 2)
        out[i, 0], out[i, 1] = poses[i, 0] + c * dx - s * dy, poses[i, 1] + s * dx + c * dy
        out[i, 2] = wrap(poses[i, 2] + dt)


def predict(
    poses: NDArray[np.float64],
    step: NDArray[np.float64],
    back: NDArray[np.float64],
    mean: NDArray[np.float64],
    sd: NDArray[np.float64],
    z: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Each pose (n, 3) after the wheels' step with its own errors of the wheels: S + C (D + lambda), lambda ~ N(mean, sd^2).

    Zhang 2011, eqs (3)-(4); as printed, (4) adds the wheels' error to a pose. step: (3,), the reported step in the frame
    half way through its turn (m, m, rad); back: J+ (3, k); mean, sd: (k,) of each wheel's error (m); z: (n, k) standard normal.
    """
    out = np.empty_like(poses)
    _roll_rows(0, poses.shape[0], poses, step, back, mean, sd, z, out)
    return out


def midway(step: NDArray[np.float64]) -> NDArray[np.float64]:
    """A step (3,) in the old base frame, seen in the frame half way through its turn."""
    c, s = np.cos(step[2] / 2), np.sin(step[2] / 2)
    return np.array([c * step[0] + s * step[1], -s * step[0] + c * step[1], step[2]])
