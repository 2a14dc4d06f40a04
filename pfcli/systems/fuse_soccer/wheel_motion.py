"""Particles after a step, by the errors of their wheels (Zhang 2011, eqs (3)-(4)) or of the odometry."""

import math

import numpy as np
from numpy.typing import NDArray

from pfcli.core.motion import odometry, wheels
from pfcli.events import Rolling, Sighting
from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.fuse_soccer.sighting_likelihood import Belief
from pfcli.systems.fuse_soccer.soccer_state import State
from pfcli.systems.shared.motion_gate import step_noise

WILD = 30.0
"""The largest surprise that counts; a robot that surprises more seems to have been carried."""
_ADAPT = 0.1
"""How fast the motion's variance follows the surprises."""


def rolled(
    state: State, sighting: Sighting, moved: NDArray[np.float64], params: Params, rng: np.random.Generator
) -> tuple[Belief, float]:
    """Particles after the step `moved` since the last frame, and the largest slip of a wheel (m)."""
    belief, now, last = state.belief, sighting.rolling, state.last.rolling
    if now is None or last is None or now.rolled_m.shape != last.rolled_m.shape:
        z = rng.standard_normal(belief.pose.shape)
        sd = math.sqrt(state.stretch) * step_noise(moved, params)
        return belief._replace(pose=odometry.predict(belief.pose, moved, sd, z)), 0.0
    mean, sd, residual = _wheel_errors(now, last, params)
    sd = math.sqrt(state.stretch) * sd
    z = rng.standard_normal((belief.pose.shape[0], sd.size))
    pose = wheels.predict(belief.pose, wheels.midway(moved), now.back, mean, sd, z)
    return belief._replace(pose=pose), float(np.abs(residual).max())


def _wheel_errors(
    now: Rolling, last: Rolling, params: Params
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mean and spread (k,) of each wheel's error in this step, and the travel that no motion explains (m)."""
    travel, way = now.rolled_m - last.rolled_m
    residual = wheels.slip(travel, now.jacobian, now.back)
    sd = params.wheel_noise * way + params.wheel_noise_m + params.slip_gain * np.abs(residual)
    return params.wheel_bias * travel, sd, residual


def stretched(stretch: float, surprise: float) -> float:
    """The motion's variance in units of its parameters: grows with frames that surprise, fades to 1 with others."""
    return min(max(stretch * (1.0 + _ADAPT * (min(surprise, WILD) - 1.0)), 1.0), 1e4)
