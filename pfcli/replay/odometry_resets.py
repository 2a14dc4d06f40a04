"""Odometry that jumps: a driver that starts anew, or a filter that is told where it is. The step is left out."""

import math

import numpy as np

from pfcli.core.geometry import between, compose
from pfcli.dropped import Dropped
from pfcli.errors import LogError
from pfcli.events import Odometry

_SECOND = 1_000_000_000
_SHORTEST_S = 0.1
"""Stamps of one burst may be nearer to each other than the motion they report."""
_NO_ROBOT = (30.0, 20.0)
"""No robot drives (m/s) or turns (rad/s) so fast."""
_FASTER, _AFTER = 8.0, 20
"""A step this many times as fast as every one before it, once there were so many, is no step of this robot."""
_SUDDEN = (0.5, 4.0, 0.7, 6.0)
"""Such a step is at least so long (m), so fast (m/s), or turns so far (rad), so fast (rad/s)."""
_HOME = (0.02, 0.02, 3.0)
"""A reset goes to the origin, this nearly (m, rad), by a step this many times as fast as the fastest before."""
_STUCK = (0.3, 0.5)
"""So far (m) or round (rad) by its twist, and a pose that has not changed is none."""


class OdometryResets:
    """Odometry without its jumps: behind each the way goes on from where it was, at the speed it had."""

    def __init__(self, dropped: Dropped) -> None:
        self._dropped = dropped
        self._last: Odometry | None = None
        self._shift: np.ndarray | None = None
        self._usual, self._usual_rate, self._steps = 0.0, 0.0, 0
        self._step: tuple[Odometry, Odometry] | None = None
        self._moved, self._by_twist = False, [0.0, 0.0]

    def __call__(self, event: Odometry) -> Odometry | None:
        """The event without what was bridged before it. Raises LogError where its pose never changes while it drives."""
        if not math.isfinite(event.x_m + event.y_m + event.yaw_rad):
            what = "position" if math.isfinite(event.yaw_rad) else "heading (its quaternion is all zero)"
            self._dropped.add("odometry without a pose", f"odometry messages without a {what} are left out")
            return None
        last, self._last = self._last, event
        if last is None:
            return event
        seconds = (event.stamp_ns - last.stamp_ns) / _SECOND
        if not self._moved:
            self._check_stuck(last, event, seconds)
        way = math.hypot(event.x_m - last.x_m, event.y_m - last.y_m)
        turn = abs(math.remainder(event.yaw_rad - last.yaw_rad, 2 * math.pi))
        span = seconds if seconds > _SHORTEST_S else _SHORTEST_S
        if (way > _SUDDEN[0] or turn > _SUDDEN[2]) and self._is_jump(event, way, turn, span):
            self._bridge(last, event, seconds, way, turn)
        else:
            self._steps += 1
            self._usual = max(self._usual, way / span)
            self._usual_rate = max(self._usual_rate, turn / span)
            self._step = (last, event)
        if self._shift is None:
            return event
        x, y, yaw = compose(self._shift, np.array([event[1:4]], np.float64))[0].tolist()
        return event._replace(x_m=x, y_m=y, yaw_rad=yaw)

    def _is_jump(self, event: Odometry, way_m: float, turn_rad: float, seconds: float) -> bool:
        fast, quick = way_m / seconds, turn_rad / seconds
        if fast > _NO_ROBOT[0] or (turn_rad > 1.0 and quick > _NO_ROBOT[1]):
            return True
        if self._steps < _AFTER:
            return False
        far, speed, round_, rate = _SUDDEN
        usual, usual_rate = self._usual, self._usual_rate
        if way_m > far and fast > max(speed, _FASTER * usual):
            return True
        if turn_rad > round_ and quick > max(rate, _FASTER * usual_rate):
            return True
        near, straight, factor = _HOME
        home = math.hypot(event.x_m, event.y_m) < near and abs(math.remainder(event.yaw_rad, 2 * math.pi)) < straight
        sudden = (way_m > far and fast > factor * max(usual, 0.2)) or (
            turn_rad > round_ and quick > factor * max(usual_rate, 0.2)
        )
        return home and sudden

    def _bridge(self, last: Odometry, event: Odometry, seconds: float, way_m: float, turn_rad: float) -> None:
        self._dropped.add(
            "reset of the odometry",
            f"the odometry jumps by {way_m:.2f} m and {math.degrees(turn_rad):.0f} deg within {seconds:.2f} s at"
            f" {event.stamp_ns / _SECOND:.2f}, which no step of this robot is; the step is left out (odometry that was reset,"
            " or a pose that was set)",
        )
        raw = np.array([last[1:4], event[1:4]], np.float64)
        before = raw[:1] if self._shift is None else compose(self._shift, raw[:1])
        reached = compose(before, self._speed()[None] * min(seconds, 1.0))
        self._shift = compose(reached, between(raw[1:], np.zeros((1, 3))))

    def _speed(self) -> np.ndarray:
        """Of the last step that was one (3,), in its own frame (m/s, m/s, rad/s)."""
        if self._step is None:
            return np.zeros(3)
        a, b = self._step
        seconds = (b.stamp_ns - a.stamp_ns) / _SECOND
        step = between(np.array([a[1:4]], np.float64), np.array([b[1:4]], np.float64))[0]
        return np.asarray(step / seconds) if seconds > 0.0 else np.zeros(3)

    def _check_stuck(self, last: Odometry, event: Odometry, seconds: float) -> None:
        self._moved = last[1:4] != event[1:4]
        speeds = (math.hypot(event.vx_mps, event.vy_mps), abs(event.yaw_rate_radps))
        for k, speed in enumerate(speeds):
            if math.isfinite(speed):
                self._by_twist[k] += speed * max(seconds, 0.0)
        if not self._moved and any(way > limit for way, limit in zip(self._by_twist, _STUCK, strict=True)):
            raise LogError(
                "the odometry, field 'pose': it never changes, while by its field 'twist' the robot has driven"
                f" {self._by_twist[0]:.2f} m and turned {math.degrees(self._by_twist[1]):.0f} deg; --motion odometry-twist"
            )
