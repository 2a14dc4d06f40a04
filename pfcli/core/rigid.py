"""Rigid motions in space as (4, 4) matrices: the child frame in the parent frame."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Motion = NDArray[np.float64]

_UNIT = 1e-6
"""Squares of a quaternion that add up to 1 so nearly are rounding, and are left as they are."""


def unit(rotation: Sequence[float]) -> tuple[float, float, float, float]:
    """The quaternion x, y, z, w with length 1. Raises ValueError where it has no direction."""
    x, y, z, w = rotation
    square = x * x + y * y + z * z + w * w
    if abs(square - 1.0) <= _UNIT:
        return x, y, z, w
    if not 1e-12 < square < math.inf:
        raise ValueError("a quaternion that is all zero or not finite")
    length = math.sqrt(square)
    return x / length, y / length, z / length, w / length


def from_quaternion(translation: Sequence[float], rotation: Sequence[float]) -> Motion:
    """Of a translation (m) and a quaternion x, y, z, w of any length. Raises ValueError where it has no direction."""
    x, y, z, w = unit(rotation)
    out = np.eye(4)
    out[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    out[:3, 3] = translation
    return out


def from_euler(xyz: Sequence[float], roll: float, pitch: float, yaw: float) -> Motion:
    """Of a translation (m) and turns about the fixed axes x, then y, then z (rad), as URDF writes them."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    c, s = math.cos(yaw), math.sin(yaw)
    out = np.eye(4)
    out[:3, :3] = [
        [c * cp, c * sp * sr - s * cr, c * sp * cr + s * sr],
        [s * cp, s * sp * sr + c * cr, s * sp * cr - c * sr],
        [-sp, cp * sr, cp * cr],
    ]
    out[:3, 3] = xyz
    return out


def inverse(motion: Motion) -> Motion:
    """The parent frame in the child frame."""
    out = np.eye(4)
    out[:3, :3] = motion[:3, :3].T
    out[:3, 3] = -motion[:3, :3].T @ motion[:3, 3]
    return out


def yaw_of(motion: Motion) -> float:
    """Heading of the x axis seen from above (rad)."""
    return math.atan2(motion[1, 0], motion[0, 0])


def tilt_of(motion: Motion) -> float:
    """Angle between the child's plane of x and y and the parent's (rad, 0 .. pi/2): upside down is level."""
    return math.acos(min(1.0, abs(float(motion[2, 2]))))


def same(a: Motion, b: Motion, tolerance: float = 1e-6) -> bool:
    """Whether two motions are one (m, and entries of the rotation)."""
    return bool(np.abs(a - b).max() <= tolerance)


def text(motion: Motion) -> str:
    """Translation, and roll, pitch, yaw in degrees, for messages."""
    r = motion[:3, :3]
    pitch = math.asin(max(-1.0, min(1.0, -float(r[2, 0]))))
    angles = (math.atan2(r[2, 1], r[2, 2]), pitch, math.atan2(r[1, 0], r[0, 0]))
    x, y, z = motion[:3, 3]
    roll_deg, pitch_deg, yaw_deg = (math.degrees(a) for a in angles)
    return f"{x:.3f}, {y:.3f}, {z:.3f} m, roll {roll_deg:.1f}, pitch {pitch_deg:.1f}, yaw {yaw_deg:.1f} deg"


def between(a: Any, b: Any, share: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Translation and quaternion at `share` of the way from a to b, each (x, y, z, qx, qy, qz, qw): linear, and by the
    great circle (Shoemake 1985)."""
    first, second = np.asarray(a, float), np.asarray(b, float)
    p, q = first[3:], second[3:]
    dot = float(p @ q)
    if dot < 0.0:
        q, dot = -q, -dot
    if dot > 1.0 - 1e-9:
        mixed = (1 - share) * p + share * q
    else:
        angle = math.acos(min(1.0, dot))
        mixed = (math.sin((1 - share) * angle) * p + math.sin(share * angle) * q) / math.sin(angle)
    return (1 - share) * first[:3] + share * second[:3], mixed
