"""By how much one clock is off another, told by turns that both have seen."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_GRID_S, _ROUNDS = 0.02, 15
_LEAST_SPREAD_RAD, _MAD = 2e-3, 1.4826
_STEP_S = 0.005
_FEWEST, _TURN_RAD = 8, 0.02


class ClockOffset(NamedTuple):
    """seconds to add to the stamps of the turns so that they fit; sd_s: its standard deviation; turns: how many told it;
    spread_rad: of a turn; scale: the reference's turns times this are theirs."""

    seconds: float
    sd_s: float
    turns: int
    spread_rad: float
    scale: float


class Turns(NamedTuple):
    """Turns (n,) rad between the times start_s and end_s (n,), and the way driven in between (m): odometry's heading errs by it
    as a random walk."""

    start_s: NDArray[np.float64]
    end_s: NDArray[np.float64]
    turn_rad: NDArray[np.float64]
    way_m: NDArray[np.float64]


def offset(
    turns: Turns, time_s: NDArray[np.float64], yaw_rad: NDArray[np.float64], about_s: float = 0.0, reach_s: float = 1.0
) -> ClockOffset | None:
    """The offset within `reach_s` of `about_s` by which the turns fit the reference's heading (k,) at its times (k,) best.

    A grid over the offset with a Cauchy cost, then Gauss-Newton with a scale of the turns, Cauchy weights. None where too
    little turns to tell. yaw_rad: without jumps of a turn.
    """
    time_s, yaw_rad = smoothed(time_s, yaw_rad)

    def seen(by: float) -> NDArray[np.float64]:
        ends = np.interp(turns.end_s + by, time_s, yaw_rad)
        return np.asarray(ends - np.interp(turns.start_s + by, time_s, yaw_rad))

    turning = np.abs(turns.turn_rad) > _TURN_RAD
    if turning.sum() < _FEWEST:
        return None
    grid = about_s + np.arange(-reach_s, reach_s + _GRID_S / 2, _GRID_S)
    costs = [np.log1p((np.asarray(turns.turn_rad - seen(by)) / 0.02) ** 2).sum() for by in grid]
    by, scale, spread = float(grid[int(np.argmin(costs))]), 1.0, 0.02
    wanted = np.eye(2)
    for _ in range(_ROUNDS):
        now = seen(by)
        slope = (seen(by + _STEP_S) - seen(by - _STEP_S)) / (2 * _STEP_S)
        rest = turns.turn_rad - scale * now
        sd = _spreads(rest, turns.way_m)
        spread = float(np.median(sd))
        weight = 1.0 / (1.0 + (rest / (2.0 * sd)) ** 2) / sd**2
        jacobian = np.stack([scale * slope, now], axis=1)
        wanted = jacobian.T @ (weight[:, None] * jacobian)
        if np.linalg.cond(wanted) > 1e12:
            return None
        step = np.linalg.solve(wanted, jacobian.T @ (weight * rest))
        by, scale = by + float(np.clip(step[0], -0.05, 0.05)), scale + float(step[1])
    sd_s = float(np.sqrt(np.linalg.inv(wanted)[0, 0]))
    if not np.isfinite(by) or abs(by - about_s) > reach_s + 0.1:
        return None
    return ClockOffset(by, sd_s, int(turning.sum()), spread, scale)


def smoothed(
    time_s: NDArray[np.float64], yaw_rad: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The heading, averaged over two periods of its messages, in steps of 5 ms.

    Between two messages interpolation averages their noise, at a message it does not: without this, an offset at which both
    clocks tick together would fit worse than its neighbours.
    """
    fine = np.arange(time_s[0], time_s[-1] + _STEP_S, _STEP_S)
    width = int(np.clip(2 * np.median(np.diff(time_s)) / _STEP_S, 8, 100)) | 1
    padded = np.pad(np.interp(fine, time_s, yaw_rad), width // 2, "edge")
    total = np.concatenate([[0.0], np.cumsum(padded)])
    return fine, np.asarray((total[width:] - total[:-width]) / width)


def _spreads(rest_rad: NDArray[np.float64], way_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviation of each turn (rad): that of the scans, and a random walk by the way, as the residuals have it."""
    driven = way_m > 1e-3
    walk = float(np.median(rest_rad[driven] ** 2 / way_m[driven])) if driven.any() else 0.0
    known = np.sqrt(_LEAST_SPREAD_RAD**2 + _MAD**2 * walk * way_m)
    return np.asarray(known * max(1.0, _MAD * float(np.median(np.abs(rest_rad) / known))))
