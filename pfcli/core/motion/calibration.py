"""What odometry errs by always, and by chance, learnt from a path that is known better."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
from pfcli.core.motion.odometry import Noise

_ROUNDS = 20
_TURN_RAD, _ENOUGH = 0.1, 20
"""A step turns from here on; so many turning steps tell how turns err."""
_WIDER = 2.0
"""The noise that is given over that which was seen: steps do not err independently."""
_REST = 0.3
"""Share of the noise of a step of usual length that is there at rest."""


class Calibration(NamedTuple):
    """Scale of ways (added to 1), sideways drift (m per m: the heading of the mount), turn per way (rad/m), scale of turns (added
    to 1); sd_xy_m, sd_yaw_rad: what remains of a step of length way_m."""

    way: float = 0.0
    drift: float = 0.0
    turn_per_m: float = 0.0
    turn: float = 0.0
    sd_xy_m: float = 0.0
    sd_yaw_rad: float = 0.0
    way_m: float = 0.0

    def corrected(self, steps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Steps (n, 3) without what odometry errs by always (m, m, rad)."""
        way = steps[:, 0]
        add = np.stack([self.way * way, self.drift * way, self.turn_per_m * way + self.turn * steps[:, 2]], axis=1)
        return np.asarray(steps + add)

    def noise(self) -> Noise:
        """The noise of a step that remains."""
        xy, yaw = _WIDER * self.sd_xy_m, _WIDER * self.sd_yaw_rad
        per_xy, per_yaw = (1 - _REST) * xy / self.way_m, (1 - _REST) * yaw / self.way_m
        return Noise(per_xy, per_xy, _REST * xy, per_yaw, per_yaw, _REST * yaw)


def calibrate(steps: NDArray[np.float64], known: NDArray[np.float64]) -> Calibration | None:
    """Robust regression of what is known of each step (n, 3) on its odometry (n, 3), base frame (m, m, rad).

    Cauchy weights, so that slips do not count. None where the robot has hardly moved.
    """
    off = known - steps
    off[:, 2] = wrap(off[:, 2])
    turning = np.abs(steps[:, 2]) >= _TURN_RAD
    way_m = float(np.median(np.abs(steps[~turning, 0]))) if (~turning).any() else 0.0
    if (~turning).sum() < _ENOUGH or way_m < 1e-3:
        return None
    way, sd_x = _slope(steps[:, 0], off[:, 0])
    drift, sd_y = _slope(steps[:, 0], off[:, 1])
    # the odometry's own noise would look like a scale of the turns where it goes straight on
    per_m, sd_yaw = _slope(steps[~turning, 0], off[~turning, 2])
    turn = 0.0
    if turning.sum() >= _ENOUGH:
        turn, sd_turn = _slope(steps[turning, 2], off[turning, 2] - per_m * steps[turning, 0])
        sd_yaw = max(sd_yaw, sd_turn)
    return Calibration(way, drift, per_m, turn, max(sd_x, sd_y), sd_yaw, way_m)


def _slope(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """Slope of y on x through the origin, and the spread of what remains."""
    weights, spread, slope = np.ones(x.size), 1e-6, 0.0
    for _ in range(_ROUNDS):
        slope = float((weights * x * y).sum() / max(float((weights * x * x).sum()), 1e-12))
        rest = y - slope * x
        spread = max(1.4826 * float(np.median(np.abs(rest))), 1e-6)
        weights = 1.0 / (1.0 + (rest / (2.0 * spread)) ** 2)
    return slope, spread
