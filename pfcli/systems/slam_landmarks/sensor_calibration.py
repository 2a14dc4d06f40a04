"""How far the sensors of a robot are off: the unknowns of its calibration, readings without their errors, and the noise that
the readings themselves show."""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap

NAMES = ("range_scale", "range_scale_per_rad", "range_offset_m", "bearing_offset_rad", "way_scale", "turn_scale")
"""What may be off, in the order of a calibration (6,). Scales are measured by true, less 1."""
SENSOR = 4
"""The first so many are of detections, the others of the odometry."""
PRIOR_SD = np.array([0.05, 0.1, 0.1, 0.03, 0.05, 0.1])
"""What is known of them before anything was seen."""


def none() -> NDArray[np.float64]:
    """(6,) Nothing is off."""
    return np.zeros(len(NAMES))


def summary(calibration: NDArray[np.float64]) -> dict[str, float]:
    """For `run.json`: scales about 1, offsets about 0."""
    at = [1.0 if "scale" in name and not name.endswith("_rad") else 0.0 for name in NAMES]
    return {name: round(a + float(v), 4) for name, a, v in zip(NAMES, at, calibration, strict=True)}


def corrected(
    z: NDArray[np.float64], step: NDArray[np.float64], calibration: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Detections (d, 2) and steps (..., 3) as sensors that are right would give them."""
    scale, per_rad, offset, turned, way, turn = calibration
    ranges = (z[:, 0] - offset) / (1.0 + scale + per_rad * z[:, 1])
    return np.column_stack([ranges, z[:, 1] - turned]), step / (1.0 + np.array([way, way, turn]))


def detection_errors(
    at: NDArray[np.float64], marks: NDArray[np.float64], z: NDArray[np.float64], calibration: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(d, 2) expected less measured range (m) and bearing (rad) of landmarks (d, 2) seen from poses at (d, 3)."""
    scale, per_rad, offset, turned, _, _ = calibration
    d = marks - at[:, :2]
    ranges = np.hypot(d[:, 0], d[:, 1]) * (1.0 + scale + per_rad * z[:, 1]) + offset
    bearing = np.arctan2(d[:, 1], d[:, 0]) - at[:, 2] + turned
    return np.column_stack([ranges - z[:, 0], wrap(bearing - z[:, 1])])
