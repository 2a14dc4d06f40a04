"""What odometry errs by always, and by chance, learnt from a path that is known better."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
from pfcli.core.motion.odometry import Noise

_ROUNDS = 20
_MAD = 1.4826
"""Standard deviation over median distance, of a Gaussian."""
_STILL_M = 0.02
"""Steps shorter than this are no driving."""
_TURN_RAD, _ENOUGH = 0.1, 20
"""A step turns from here on; so many turning steps tell how turns err."""
_WIDER = 2.0
"""The noise that is given over that which was seen: steps do not err independently."""
_REST = 0.3
"""Share of the noise of a step of usual length that is there at rest."""


class Calibration(NamedTuple):
    """Scale of ways (added to 1), drift to the left of the way (m per m: the heading of the mount), turn per way ahead (rad/m),
    scale of turns (added to 1); sd_xy_m, sd_yaw_rad: what remains of a step of length way_m."""

    way: float
    drift: float
    turn_per_m: float
    turn: float
    sd_xy_m: float
    sd_yaw_rad: float
    way_m: float

    def corrected(self, steps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Steps (n, 3) without what odometry errs by always (m, m, rad)."""
        x, y, yaw = steps.T
        add = [self.way * x - self.drift * y, self.way * y + self.drift * x, self.turn_per_m * x + self.turn * yaw]
        return np.asarray(steps + np.stack(add, axis=1))

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
    ways = np.hypot(steps[~turning, 0], steps[~turning, 1])
    if ways.size < _ENOUGH or np.median(ways) < _STILL_M:
        return None
    # what is scaled and what is turned of a step, in one: both parts of it, as a complex number
    xy = _slope(steps[:, 0] + 1j * steps[:, 1], off[:, 0] + 1j * off[:, 1])
    # odometry's own noise would look like a scale of turns where it goes straight on, or of the way ahead where it goes sideways
    ahead = ~turning & (np.abs(steps[:, 0]) >= np.abs(steps[:, 1]))
    per_m = _slope(steps[ahead, 0], off[ahead, 2]) if ahead.sum() >= _ENOUGH else _Slope(0j, 0.0)
    rest = off[:, 2] - per_m.slope.real * steps[:, 0]
    turn = _slope(steps[turning, 2], rest[turning]) if turning.sum() >= _ENOUGH else _Slope(0j, 0.0)
    sd_yaw = max(per_m.spread, turn.spread, _MAD * float(np.median(np.abs(rest[~turning]))))
    return Calibration(
        xy.slope.real, xy.slope.imag, per_m.slope.real, turn.slope.real, xy.spread, sd_yaw, float(np.median(ways))
    )


class _Slope(NamedTuple):
    """slope of y on x through the origin; spread: standard deviation of a coordinate of what remains."""

    slope: complex
    spread: float


def _slope(x: NDArray[Any], y: NDArray[Any]) -> _Slope:
    weights, spread, slope = np.ones(x.size), 1e-6, 0j
    for _ in range(_ROUNDS):
        slope = complex((weights * np.conj(x) * y).sum() / max(float((weights * np.abs(x) ** 2).sum()), 1e-12))
        rest = y - slope * x
        parts = np.concatenate([rest.real, rest.imag]) if np.iscomplexobj(y) else rest.real
        spread = max(_MAD * float(np.median(np.abs(parts))), 1e-6)
        weights = 1.0 / (1.0 + (np.abs(rest) / (2.0 * spread)) ** 2)
    return _Slope(slope, spread)
