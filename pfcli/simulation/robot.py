"""A differential-drive robot that follows way points, and the odometry its wheels report."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Robot(NamedTuple):
    """Speed (m/s), turn rate (rad/s), wheel noise per metre (m), the same for each wheel's scale, and slips.

    scale_left, scale_right: what the odometry believes a metre of each wheel to be; slip_m, slip_deg: size of an
    odometry jump; slip_every_m: way between two jumps (0: none).
    """

    speed_mps: float = 0.6
    turn_radps: float = 0.8
    track_m: float = 0.33
    noise_m_per_m: float = 0.02
    scale_left: float = 1.0
    scale_right: float = 1.0
    slip_m: float = 0.0
    slip_deg: float = 0.0
    slip_every_m: float = 0.0


ROBOTS = {
    "pioneer": Robot(noise_m_per_m=0.01, scale_left=0.998, scale_right=1.001),
    "slips": Robot(slip_m=0.3, slip_deg=15.0, slip_every_m=12.0),
    "wheel-5-percent": Robot(scale_left=1.05),
}
"""Robots by name; pioneer stands for the Pioneer 3-DX of Zhang 2016, section 3.2."""

STEP_S = 0.05


def drive(route: NDArray[np.float64], robot: Robot) -> Iterator[tuple[float, float, float]]:
    """True poses every STEP_S: turn towards the next way point, drive there, round corners by arcs.

    A way point that is NaN carries the robot to the one after it, where it looks towards the next.
    """
    x, y, yaw = math.nan, math.nan, math.nan
    for k, (tx, ty) in enumerate(route.tolist()):
        if math.isnan(tx):
            continue
        if k == 0 or math.isnan(route[k - 1, 0]):
            x, y = tx, ty
            yaw = math.atan2(route[k + 1, 1] - y, route[k + 1, 0] - x)
            continue
        while math.hypot(tx - x, ty - y) > 0.15:
            turn = math.remainder(math.atan2(ty - y, tx - x) - yaw, 2 * math.pi)
            speed = robot.speed_mps * max(0.0, 1.0 - abs(turn) / 0.6)
            rate = max(-robot.turn_radps, min(robot.turn_radps, 2.5 * turn))
            middle = yaw + rate * STEP_S / 2
            x += speed * STEP_S * math.cos(middle)
            y += speed * STEP_S * math.sin(middle)
            yaw = math.remainder(yaw + rate * STEP_S, 2 * math.pi)
            yield x, y, yaw


class WheelOdometry:
    """Integrates what noisy, wrongly scaled and sometimes slipping wheels report."""

    def __init__(self, robot: Robot, rng: np.random.Generator) -> None:
        self._robot = robot
        self._rng = rng
        self._pose = (0.0, 0.0, 0.0)
        self._last: tuple[float, float, float] | None = None
        self._way = 0.0
        self.wheels_m = (0.0, 0.0)

    def __call__(self, true: tuple[float, float, float]) -> tuple[float, float, float]:
        """Odometry pose once the robot has truly reached `true`."""
        if self._last is None:
            self._last = true
            return self._pose
        x0, y0, yaw0 = self._last
        turn = math.remainder(true[2] - yaw0, 2 * math.pi)
        middle = yaw0 + turn / 2
        forward = math.cos(middle) * (true[0] - x0) + math.sin(middle) * (true[1] - y0)
        self._last = true
        robot = self._robot
        wheels = []
        for side, scale in ((-1, robot.scale_left), (1, robot.scale_right)):
            way = forward + side * turn * robot.track_m / 2
            wheels.append(
                scale * way + robot.noise_m_per_m * math.sqrt(abs(way)) * 0.5 * float(self._rng.standard_normal())
            )
        self.wheels_m = (self.wheels_m[0] + wheels[0], self.wheels_m[1] + wheels[1])
        self._advance((wheels[0] + wheels[1]) / 2, (wheels[1] - wheels[0]) / robot.track_m)
        self._way += abs(forward)
        if robot.slip_every_m and self._way >= robot.slip_every_m:
            self._way = 0.0
            sign = 1.0 if self._rng.random() < 0.5 else -1.0
            self._advance(sign * robot.slip_m, sign * math.radians(robot.slip_deg))
        return self._pose

    def carried(self, true: tuple[float, float, float]) -> None:
        """The robot was lifted and put down at `true`: its wheels noticed nothing."""
        self._last = true

    def _advance(self, forward: float, turn: float) -> None:
        x, y, yaw = self._pose
        middle = yaw + turn / 2
        self._pose = (
            x + forward * math.cos(middle),
            y + forward * math.sin(middle),
            math.remainder(yaw + turn, 2 * math.pi),
        )
