"""Wheels and a sensor calibrated together from any drive: how the sensor moved between two instants, by what it saw, against how
the wheels say the base moved. Censi et al. 2013, 'Simultaneous calibration of odometry and sensor parameters for mobile
robots', by nonlinear least squares with a Cauchy cost, and with the sensor's clock."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pfcli.core.geometry import between, compose
from pfcli.core.motion.clock_offset import smoothed

NAMES = ("left", "right", "track", "x", "y", "yaw", "seconds")
_FEWEST, _ROUNDS, _MAD = 20, 4, 1.4826
_LEAST = np.array([1e-3, 1e-3, 5e-4])
"""Motions of the sensor are known no better (m, m, rad)."""
_PRIOR = np.array([0.2, 0.2, 0.3, 1.0, 1.0, 1.0, 0.5])
"""Standard deviations within which parameters are looked for about what is given."""
_TOLD = np.array([0.01, 0.01, 0.02, 0.03, 0.03, 0.02, 0.02])
"""A drive that leaves a parameter less sure than this does not tell it."""


_ASIDE_S, _SHARPER = (-0.3, -0.15, 0.15, 0.3), 0.08
"""At these times beside the best one the motions must fit worse by this share."""


class Motions(NamedTuple):
    """step (n, 3): how the sensor moved between start_s and end_s (n,), as it says itself (m, m, rad)."""

    start_s: NDArray[np.float64]
    end_s: NDArray[np.float64]
    step: NDArray[np.float64]


class Rolling(NamedTuple):
    """rolled_m (k, 2): how far the left and the right wheel have rolled at time_s (k,), by the given radii; the given track."""

    time_s: NDArray[np.float64]
    rolled_m: NDArray[np.float64]
    track_m: float


class Calibrated(NamedTuple):
    """value, sd (7,) of `NAMES`: scale of the left and the right wheel's radius and of the track, x, y (m) and yaw (rad) of the
    sensor on the base, seconds to add to the sensor's stamps. told (7,): whether the drive tells it; the rest is as given.
    spread (3,): of the sensor's motions about the wheels' (m, m, rad)."""

    value: NDArray[np.float64]
    sd: NDArray[np.float64]
    told: NDArray[np.bool_]
    spread: NDArray[np.float64]


def calibrate(motions: Motions, rolling: Rolling, given: NDArray[np.float64]) -> Calibrated | None:
    """The parameters that let the wheels explain the sensor's motions best. given (7,): where to start, and what is kept of
    what the drive does not tell. None for fewer than 20 motions."""
    if motions.start_s.size < _FEWEST:
        return None
    fine_s, left = smoothed(rolling.time_s, rolling.rolled_m[:, 0])
    right = smoothed(rolling.time_s, rolling.rolled_m[:, 1])[1]
    wheels = _Wheels(fine_s, np.stack([np.diff(left), np.diff(right)], axis=1), rolling.track_m)
    free = np.ones(7, np.bool_)
    found = _fit(motions, wheels, given, free)
    while (untold := free & ((found.sd > _TOLD) | _idle_clock(motions, wheels, found))).any():
        # what the drive does not tell is put back to what is given, and the others are fitted again
        free &= ~untold
        found = _fit(motions, wheels, given, free)
    if not free[2]:
        return found
    # of turns the wheels err rather than the sensor: what remains counts in the wheels' own units, or turns come out too small
    return _fit(motions, wheels, given, free, wheels_turn=True)._replace(sd=found.sd)


class _Wheels(NamedTuple):
    """Steps (k, 2) of the wheels between the instants time_s (k + 1,) (m)."""

    time_s: NDArray[np.float64]
    steps_m: NDArray[np.float64]
    track_m: float


def _idle_clock(motions: Motions, wheels: _Wheels, found: Calibrated) -> NDArray[np.bool_]:
    """(7,) whether the clock only seems to be told: noise of the wheels has slopes too, but fits no worse at another time."""

    def cost(seconds: float) -> float:
        value = found.value.copy()
        value[6] += seconds
        return float(np.log1p((_off(motions, wheels, value) / found.spread / 2.0) ** 2).sum())

    best, least = cost(0.0), min(map(cost, _ASIDE_S))
    return np.asarray(np.arange(7) == (6 if least < (1.0 + _SHARPER) * best else -1))


def _fit(
    motions: Motions,
    wheels: _Wheels,
    given: NDArray[np.float64],
    free: NDArray[np.bool_],
    wheels_turn: bool = False,
) -> Calibrated:
    """Fit the free parameters; how much the motions spread is learnt from what remains of them."""
    value, spread = given.astype(np.float64).copy(), np.full(3, 0.01)
    jacobian = np.eye(int(free.sum()))
    for _ in range(_ROUNDS if free.any() else 0):
        found = least_squares(
            _rest,
            value[free],
            loss="cauchy",
            f_scale=2.0,
            x_scale=_TOLD[free],
            max_nfev=30,
            args=(motions, wheels, given, free, spread, wheels_turn),
        )
        value[free], jacobian = found.x, found.jac
        spread = np.maximum(_LEAST, _MAD * np.median(np.abs(_off(motions, wheels, value)), axis=0))
    sd = np.zeros(7)
    sd[free] = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return Calibrated(value, sd, free.copy(), spread)


def _rest(
    part: NDArray[np.float64],
    motions: Motions,
    wheels: _Wheels,
    given: NDArray[np.float64],
    free: NDArray[np.bool_],
    spread: NDArray[np.float64],
    wheels_turn: bool,
) -> NDArray[np.float64]:
    value = given.astype(np.float64).copy()
    value[free] = part
    units = np.array([1.0, 1.0, value[:2].mean() / value[2] if wheels_turn else 1.0])
    off = _off(motions, wheels, value) / (spread * units)
    return np.concatenate([off.ravel(), (part - given[free]) / _PRIOR[free]])


def _off(motions: Motions, wheels: _Wheels, value: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) by how much the sensor's motions differ from what the wheels say with these parameters."""
    rolled = wheels.steps_m * value[:2]
    turn = (rolled[:, 1] - rolled[:, 0]) / (wheels.track_m * value[2])
    ahead = rolled.mean(axis=1)
    yaw = np.concatenate([[0.0], np.cumsum(turn)])
    middle = yaw[:-1] + turn / 2
    x = np.concatenate([[0.0], np.cumsum(ahead * np.cos(middle))])
    y = np.concatenate([[0.0], np.cumsum(ahead * np.sin(middle))])
    start, end = (
        np.stack([np.interp(at + value[6], wheels.time_s, v) for v in (x, y, yaw)], axis=1)
        for at in (motions.start_s, motions.end_s)
    )
    mount = value[3:6].reshape(1, 3)
    said = between(compose(start, mount), compose(end, mount))
    return np.asarray(between(said, motions.step))
