"""Values that no robot can have sent: what a flipped bit or a wrong unit leaves of a reading that could be decoded.

Limits are far beyond any robot: they keep sums finite. Readings that are merely wrong are the filters' business.
"""

import math
from collections.abc import Callable
from typing import Any

from pfcli.events import Event, Heading, Odometry, Range, Scan, Steering, Truth, Twist, YawRate
from pfcli.formats.messages import Raw
from pfcli.formats.raw_readings import BodyPose, BodySpeed, Gyroscope

FARTHEST_M = 1e8
"""Twice around the earth; coordinates of a map projection (UTM: 1e7 m) are well within."""
_FASTEST = 1e6
_TURNS_RAD = 1e6
_WIDEST_RAD = 8 * math.pi


def fault(event: Event | Raw) -> str:
    """What is impossible about an event, '' if nothing. NaN is for those who read the value: it may mean 'not there'."""
    check = _CHECKS.get(type(event))
    return check(event) if check is not None else ""


def _pose(event: Any) -> str:
    """A heading that is NaN is not there."""
    turned = abs(event.yaw_rad) <= _TURNS_RAD or event.yaw_rad != event.yaw_rad
    if abs(event.x_m) <= FARTHEST_M and abs(event.y_m) <= FARTHEST_M and turned:
        return ""
    return f"has a pose that cannot be: {event.x_m:g}, {event.y_m:g} m, {event.yaw_rad:g} rad"


def _odometry(event: Any) -> str:
    return _pose(event) or _speeds((event.vx_mps, event.vy_mps, event.yaw_rate_radps))


def _speeds(values: tuple[float, ...]) -> str:
    for value in values:
        if abs(value) > _FASTEST:
            return f"has a speed that cannot be: {value:g}"
    return ""


def _scan(event: Any) -> str:
    low, step, count = event.angle_min_rad, event.angle_increment_rad, event.ranges_m.size
    if not (math.isfinite(low) and math.isfinite(step)) or (step == 0.0 and count > 1):
        return "has a field 'angle_increment' or 'angle_min' that is zero or not finite"
    if abs(low) > _WIDEST_RAD or abs(step) * count > _WIDEST_RAD:
        return f"has {count} beams of {step:g} rad from {low:g} rad on, which are more than four turns"
    return "" if event.range_max_m <= FARTHEST_M or event.range_max_m == math.inf else "has no field 'range_max' [m]"


def _heading(event: Any) -> str:
    return "" if abs(event.yaw_rad) <= _TURNS_RAD else f"has a heading that cannot be: {event.yaw_rad:g} rad"


_CHECKS: dict[type, Callable[[Any], str]] = {
    Odometry: _odometry,
    Truth: _pose,
    BodyPose: lambda e: "" if all(abs(v) <= FARTHEST_M for v in e.position_m) else "has a pose that cannot be",
    BodySpeed: lambda e: _speeds(e.linear_mps + e.angular_radps),
    Gyroscope: lambda e: _speeds(e.rates_radps),
    Twist: lambda e: _speeds((e.vx_mps, e.vy_mps, e.yaw_rate_radps)),
    Steering: lambda e: _speeds(tuple(e[1:])),
    YawRate: lambda e: _speeds(tuple(e[1:])),
    Scan: _scan,
    Range: lambda e: (
        "" if not abs(e.range_m) < math.inf or abs(e.range_m) <= FARTHEST_M else "has no range that can be"
    ),
    Heading: _heading,
}
