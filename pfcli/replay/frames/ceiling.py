"""Where the ceiling is, told by a scanner that leans: end points pile up at one height, and nothing is above it."""

import math

import numpy as np
from numpy.typing import NDArray

from pfcli.events import Scan
from pfcli.replay.frames.robot_frames import Mount

EVERY, MOST = 5, 400
"""Every so-manyth scan is looked at, no more than this many."""
_BIN_M, _THICK = 0.02, 4
_ABOVE_M, _FEWEST, _SHARE, _OVER = 0.3, 200, 0.12, 0.02
"""Of so many end points that lie so far (m) above the sensor, this share lies on a ceiling, and next to nothing over it."""


def heights(scan: Scan, mount: Mount) -> NDArray[np.float64]:
    """Heights above the floor (m) of the end points of a scan."""
    r, angle = scan.ranges_m.astype(np.float64), scan.angles_rad()
    hit = np.isfinite(r) & (r > scan.range_min_m) & (r < scan.range_max_m)
    up = mount.motion[2, 0] * np.cos(angle) + mount.motion[2, 1] * np.sin(angle)
    return np.asarray(mount.height_m + r[hit] * up[hit])


def ceiling_m(height: NDArray[np.float64], sensor_m: float) -> float:
    """Height below which nothing is the ceiling (m), of all end points of a drive; infinity where no ceiling shows."""
    high = height[height > sensor_m + _ABOVE_M]
    if high.size < _FEWEST:
        return math.inf
    low = sensor_m + _ABOVE_M
    counts = np.bincount(((high - low) / _BIN_M).astype(np.int64))
    piled = np.convolve(counts, np.ones(_THICK), "full")[_THICK - 1 :]
    top = int(np.argmax(piled))
    over = counts[top + _THICK :].sum()
    if piled[top] < _SHARE * high.size or over > _OVER * high.size:
        return math.inf
    return low + top * _BIN_M - _BIN_M
