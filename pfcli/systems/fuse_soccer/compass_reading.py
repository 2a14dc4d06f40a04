"""A reading of the compass: in the field's frame, and what it teaches of the compass's bias."""

import math

from pfcli.core import estimate
from pfcli.core.sensor import compass
from pfcli.events import Sighting
from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.fuse_soccer.sighting_likelihood import Heard
from pfcli.systems.fuse_soccer.soccer_state import Glance, State

CERTAIN = 0.8
"""A hypothesis with this share of the weight is believed."""
_LEARN_SD_RAD = 0.15


def heard_of(state: State, sighting: Sighting, params: Params) -> Heard | None:
    """The compass in the field's frame, its bias removed; readings of one memory count as one."""
    if sighting.compass is None or not params.compass:
        return None
    yaw = sighting.compass.yaw_rad + math.radians(params.compass_north_deg - 90.0) - state.bias.mean_rad
    own = sighting.compass.sigma_rad
    sigma = own if math.isfinite(own) and own > 0.0 else math.radians(params.compass_sigma_deg)
    if state.heard_ns == 0 or params.variant == "paper" or params.compass_memory_s == 0.0:
        return Heard(yaw, sigma, 1.0)
    seconds = (sighting.stamp_ns - state.heard_ns) * 1e-9
    return Heard(yaw, sigma, min(1.0, seconds / params.compass_memory_s))


def learned(
    state: State, glance: Glance, found: estimate.PoseEstimate, sd_yaw: float, params: Params
) -> tuple[compass.Bias, float]:
    """The bias after this reading, which a filter that is sure of its heading teaches; and what the reading differs by."""
    heard = glance.heard
    if heard is None:
        return state.bias, math.nan
    residual = math.remainder(heard.yaw_rad - float(found.pose[2]), 2 * math.pi)
    if not params.compass_bias or sd_yaw > _LEARN_SD_RAD or found.mass < CERTAIN:
        return state.bias, residual
    seconds = (glance.sighting.stamp_ns - state.heard_ns) * 1e-9 if state.heard_ns else params.compass_memory_s
    return compass.learn(state.bias, residual, heard.sigma_rad, seconds, params.compass_memory_s), residual
