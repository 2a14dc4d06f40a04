"""Readings as messages give them, in the frame of their sensor: `pfcli.replay.frames` makes events of them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""x, y, z, w, of length 1"""
UNKNOWN: Vector = (float("nan"),) * 3


class Gyroscope(NamedTuple):
    """Turn rates (rad/s) and accelerations (m/s^2, NaN where the log has none) about and along the sensor's axes."""

    stamp_ns: int
    rates_radps: Vector
    acceleration_mps2: Vector = UNKNOWN


class Attitude(NamedTuple):
    """The sensor's orientation against a level frame whose x is where headings count from; sigma_rad: of the heading."""

    stamp_ns: int
    rotation: Quaternion
    sigma_rad: float


class Magnetometer(NamedTuple):
    """The magnetic field along the sensor's axes (tesla)."""

    stamp_ns: int
    field: Vector


class BodyPose(NamedTuple):
    """A frame's pose (m) in another one, and its speeds (m/s, rad/s) along and about its own axes, NaN where there are none."""

    stamp_ns: int
    position_m: Vector
    rotation: Quaternion
    linear_mps: Vector = UNKNOWN
    angular_radps: Vector = UNKNOWN


class BodySpeed(NamedTuple):
    """Speeds (m/s, rad/s) of a frame along and about its own axes."""

    stamp_ns: int
    linear_mps: Vector
    angular_radps: Vector


class Cloud(NamedTuple):
    """Points (n, 3) that a scanner of many planes has seen (m)."""

    stamp_ns: int
    points_m: NDArray[np.float32]


class Spots(NamedTuple):
    """Places (n, 3) of what vision detected (m), and what it is."""

    stamp_ns: int
    ids: tuple[str, ...]
    points_m: NDArray[np.float64]
