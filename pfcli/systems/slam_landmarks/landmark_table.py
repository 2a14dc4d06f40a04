"""The landmarks at the end of a run: their table, and which of them are doubtful."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.dropped import Dropped
from pfcli.errors import printable
from pfcli.systems.slam_landmarks import landmark_smoother
from pfcli.systems.slam_landmarks.particle_history import Past

_MANY, _MOVED = 10, 50.0
"""A landmark with so many detections moves if their median squared distance is this."""


def ids(past: Past, names: dict[str, int]) -> list[str]:
    """Of the landmarks of a particle: their names, or numbers where they have none."""
    by_column = {column: name for name, column in names.items()}
    return [by_column.get(k, str(k)) for k in past.columns.tolist()]


def table(past: Past, marks: NDArray[np.float64], names: dict[str, int]) -> dict[str, Any]:
    """Columns of `landmarks.parquet`; marks (l, FIELDS): of the particle."""
    found: dict[str, Any] = {"id": ids(past, names)}
    found |= dict(zip(("x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2"), marks[:, :5].T, strict=True))
    found["sightings"] = np.bincount(past.log.of, minlength=past.columns.size)
    return found


def doubt(past: Past, scales: NDArray[np.float64], names: dict[str, int], mapped: bool, dropped: Dropped) -> None:
    """Say which landmarks do not stay where they are; and, unless they are `mapped`, where none corrects the odometry."""
    squares = landmark_smoother.squared_errors(past.track, past.places, scales, past.log)
    for k, name in enumerate(ids(past, names)):
        own = squares[past.log.of == k]
        if own.size >= _MANY and np.median(own) > _MOVED:
            far = f"it is seen {np.sqrt(np.median(own)):.0f} standard deviations off"
            dropped.add(
                "landmark that moves",
                f"landmark {printable(name)!r} does not stay in one place: {far}; it counts little",
            )
    if not mapped and np.bincount(past.log.of, minlength=1).max() < 2:
        dropped.add("landmarks seen once", "no landmark was seen twice: the track is that of the odometry alone")
