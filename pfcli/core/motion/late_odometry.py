"""How much later odometry's clock is than the scans': where it is, turns come late, and no scale of turns mends that.

`clock_offset` tells the same of raw turns; here odometry that also turns as it drives, and steps of a chain of scans.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pfcli.core.motion.odometry_calibration import calibrate

_MOST_S, _COARSE_S, _FINE_S = 1.0, 0.1, 0.02
_WIDE_RAD = 0.02
"""Scale of the robust cost of what turns differ by."""
_SCALE = 0.3
"""Odometry that measures turns wrong by more than this share is out of time: turns that do not meet explain nothing."""
_TURN_RAD, _TURNS = 0.05, 40
"""A step turns from here on; so many turning steps tell."""
_BETTER = 0.8
"""An offset is believed in where it brings the cost to this share of that without one."""


def offset_of_odometry(steps_at: Callable[[float], NDArray[np.float64]], known: NDArray[np.float64]) -> float:
    """Seconds to add to a scan's stamp to find its odometry; 0 where none explains the turns much better.

    steps_at: steps (n, 3) of the odometry (m, m, rad) for an offset (s); known: (n, 3), the same steps by scans.
    """
    turning = np.abs(known[:, 2]) >= _TURN_RAD
    if turning.sum() < _TURNS:
        return 0.0
    usual = _cost(steps_at(0.0), known, turning)
    best, lowest = 0.0, np.inf if usual is None else usual
    for grain, half in ((_COARSE_S, _MOST_S), (_FINE_S, _COARSE_S)):
        middle, count = best, round(half / grain)
        for offset in (middle + grain * k for k in range(-count, count + 1) if k):
            cost = _cost(steps_at(offset), known, turning)
            if cost is not None and cost < lowest:
                best, lowest = offset, cost
    return round(best, 3) if usual is None or lowest < _BETTER * usual else 0.0


def _cost(steps: NDArray[np.float64], known: NDArray[np.float64], turning: NDArray[np.bool_]) -> float | None:
    """Mean robust cost (Cauchy) of what the turns differ by once odometry is calibrated; None where the robot has hardly moved,
    or the scale of turns makes no sense."""
    calibration = calibrate(steps, known)
    if calibration is None or abs(calibration.turn) > _SCALE:
        return None
    off = known[turning, 2] - calibration.corrected(steps)[turning, 2]
    off -= 2 * np.pi * np.round(off / (2 * np.pi))
    return float(np.log1p((off / _WIDE_RAD) ** 2).mean())
