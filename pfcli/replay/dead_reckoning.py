"""Wheel bases, and poses from what wheels, speeds or a gyroscope report."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core.motion import joint_wraps, wheels
from pfcli.dropped import Dropped
from pfcli.errors import UsageError
from pfcli.events import Event, Odometry, Steering, Ticks, Twist, Wheels, YawRate
from pfcli.replay.odometry_resets import OdometryResets
from pfcli.replay.settings import Drive

SECOND = 1_000_000_000

_UPRIGHT_RAD = 1.5
_FASTEST_MPS, _SHORTEST_S = 30.0, 0.1
"""No wheel of a robot runs faster; stamps of one burst may be nearer to each other than the motion they report."""


class DeadReckoning:
    """Turns motion events into odometry poses (Zhang 2014, eqs (2)-(4); Zhang 2011, eq. (3)); ticks may wrap at 32 bits, and
    a jump of theirs that no robot can drive is counted in `dropped` and left out.

    rolled: (2, k), how far each wheel has rolled, with its sign and without (m); jacobian: of the base, None before the
    first encoder message; back: its pseudo-inverse.
    """

    def __init__(self, source: str, drive: Drive, dropped: Dropped | None = None) -> None:
        self._loss = Dropped() if dropped is None else dropped
        self._source = source
        self._drive = drive
        self._pose = (0.0, 0.0, 0.0)
        self._last_ns: int | None = None
        self._last_speed = (0.0, 0.0, 0.0)
        self._names: tuple[str, ...] = ()
        self._order = np.empty(0, np.int64)
        self._radius = np.empty(0)
        self.back = np.empty((3, 0))
        self._wheels: NDArray[Any] | None = None
        self.jacobian: wheels.Jacobian | None = None
        self.rolled = np.zeros((2, 0))
        self._may_wrap, self._joint_rate = np.empty(0, np.bool_), np.empty(0)
        self._resets = OdometryResets(self._loss)
        self._yaw_rate = 0.0
        self._speed = 0.0

    def __call__(self, event: Event) -> Odometry | None:
        """The odometry pose after this event, or None where it says nothing about motion yet."""
        if isinstance(event, Odometry):
            if self._source == "odometry":
                return self._resets(event)
            if self._source == "imu":
                self._speed = event.vx_mps
                return None
            return self._integrate(event.stamp_ns, (event.vx_mps, event.vy_mps, event.yaw_rate_radps))
        if isinstance(event, Twist):
            if self._source == "imu":
                self._speed = event.vx_mps
                return None
            return self._integrate(event.stamp_ns, (event.vx_mps, event.vy_mps, event.yaw_rate_radps))
        if isinstance(event, Steering):
            return self._steer(event)
        if isinstance(event, YawRate):
            return self._integrate(event.stamp_ns, (self._speed, 0.0, event.yaw_rate_radps))
        if isinstance(event, Wheels | Ticks):
            return self._roll(event)
        return None

    def _steer(self, event: Steering) -> Odometry | None:
        """A car rolls about the point where its axles meet; the pose is its rear axle's."""
        wheelbase = self._drive.axles_m
        if self._source == "imu":
            self._speed = event.speed_mps
            return None
        if wheelbase <= 0.0:
            raise UsageError("motion from speed and steering angle needs --axle-distance-m (> 0), the car's wheelbase")
        if not abs(event.angle_rad) < _UPRIGHT_RAD:
            self._loss.add("steering angle", "steering angles of 86 degrees and more, or none, are left out")
            return None
        yaw_rate = event.speed_mps * math.tan(event.angle_rad) / wheelbase
        return self._integrate(event.stamp_ns, (event.speed_mps, 0.0, yaw_rate))

    def _integrate(self, stamp_ns: int, speed: tuple[float, float, float]) -> Odometry | None:
        """Mean speed over the interval, midpoint heading."""
        if not all(math.isfinite(v) for v in speed):
            return None
        dt = 0.0 if self._last_ns is None else (stamp_ns - self._last_ns) / SECOND
        vx, vy, w = ((a + b) / 2 for a, b in zip(speed, self._last_speed, strict=True))
        self._last_ns, self._last_speed = stamp_ns, speed
        return self._advance(stamp_ns, vx * dt, vy * dt, w * dt)

    def _advance(self, stamp_ns: int, dx: float, dy: float, dyaw: float) -> Odometry:
        x, y, yaw = self._pose
        middle = yaw + dyaw / 2
        c, s = math.cos(middle), math.sin(middle)
        self._pose = (x + c * dx - s * dy, y + s * dx + c * dy, math.remainder(yaw + dyaw, 2 * math.pi))
        return Odometry(stamp_ns, *self._pose)

    def _roll(self, event: Wheels | Ticks) -> Odometry | None:
        if not event.names:
            return None
        if event.names != self._names:
            if self._names and not set(self._names) <= set(event.names):
                self._loss.add(
                    "message without the wheels",
                    f"a message of {', '.join(event.names)} names no wheels; it is left out",
                )
                return None
            self._rig(event.names)
        turn = (
            2
            * math.pi
            / (event.ticks_per_turn if isinstance(event, Ticks) else self._drive.ticks_per_turn or 2 * math.pi)
        )
        if isinstance(event, Ticks):
            counts = event.ticks[self._order]
            if not event.cumulative:
                return self._wheel_step(event.stamp_ns, counts * turn)
            before, self._wheels = self._wheels, counts
            if before is None:
                return self._stand(event.stamp_ns)
            steps = [_unwrapped(now, old) for now, old in zip(counts.tolist(), before.tolist(), strict=True)]
            return self._wheel_step(event.stamp_ns, np.array(steps) * turn)
        position = event.position_rad[self._order]
        if np.isfinite(position).all():
            before, self._wheels = self._wheels, position
            if before is None:
                return self._stand(event.stamp_ns)
            angles = self._unwrapped(event, (position - before) * turn, before * turn, position * turn)
            return self._wheel_step(event.stamp_ns, angles)
        rolling = event.velocity_radps[self._order] * self._radius
        if self._last_ns is not None and np.isfinite(rolling).all():
            travel = rolling * (event.stamp_ns - self._last_ns) / SECOND
            self.rolled = self.rolled + np.stack([travel, np.abs(travel)])
        speed = self.back @ rolling
        return self._integrate(event.stamp_ns, (float(speed[0]), float(speed[1]), float(speed[2])))

    def _unwrapped(self, event: Wheels, step: NDArray[Any], before: NDArray[Any], now: NDArray[Any]) -> NDArray[Any]:
        """Steps of joints (rad) that may be reported within one turn; what is expected is as fast as the joints say they turn,
        or as they turned before."""
        self._may_wrap = self._may_wrap & joint_wraps.within_a_turn(before) & joint_wraps.within_a_turn(now)
        seconds = 0.0 if self._last_ns is None else (event.stamp_ns - self._last_ns) / SECOND
        said = event.velocity_radps[self._order]
        rate = said if np.isfinite(said).all() and not self._drive.ticks_per_turn else self._joint_rate
        angles, wraps = joint_wraps.unwrapped(step, rate * seconds, self._may_wrap)
        if wraps:
            self._loss.read["wraps of wheel joints"] += wraps
        if seconds > 0.0:
            self._joint_rate = angles / seconds
        return angles

    def _stand(self, stamp_ns: int) -> Odometry:
        """The first reading of counters says where they stand, not how far the wheels came."""
        self._last_ns = stamp_ns
        return Odometry(stamp_ns, *self._pose)

    def _wheel_step(self, stamp_ns: int, angles: NDArray[Any]) -> Odometry:
        travel = angles * self._radius
        far = float(np.abs(travel).max())
        seconds = 0.0 if self._last_ns is None else (stamp_ns - self._last_ns) / SECOND
        self._last_ns = stamp_ns
        if far > _FASTEST_MPS * max(seconds, _SHORTEST_S):
            self._loss.add(
                "jump of the encoders",
                f"wheel encoders jump by {far:.1f} m within {seconds:.2f} s; such steps are left out"
                " (a counter that was reset, or --wheel-radius-m is wrong)",
            )
            return Odometry(stamp_ns, *self._pose)
        self.rolled = self.rolled + np.stack([travel, np.abs(travel)])
        dx, dy, dyaw = (self.back @ travel).tolist()
        return self._advance(stamp_ns, dx, dy, dyaw)

    def _rig(self, names: tuple[str, ...]) -> None:
        """Learn which of the log's joints is which wheel of the base."""
        drive = self._drive
        jacobian = drive.jacobian()
        count = jacobian.shape[0]
        wanted = drive.joints
        if wanted is None:
            wanted = tuple(n for side in drive.sides for n in names if all(word in n.lower() for word in side))
            if len(wanted) != count or len(set(wanted)) != count:
                order = ",".join(" ".join(side).upper().replace(" ", "_") for side in drive.sides)
                how = order or "with their names, in the order of --wheel-angle-deg"
                raise UsageError(f"which wheel is which? The log has {', '.join(names)}; say --wheel-joints {how}")
        if len(wanted) != count:
            raise UsageError(f"--wheel-joints names {len(wanted)} wheels, the {drive.base} base has {count}")
        missing = [w for w in wanted if w not in names]
        if missing:
            raise UsageError(f"--wheel-joints: the log has no joint {missing[0]!r}, but {', '.join(names)}")
        if len(drive.radius_m) not in (1, count):
            raise UsageError(
                f"--wheel-radius-m is given {len(drive.radius_m)} times; give it once, or once for each of {count} wheels"
            )
        self._names, self._order = names, np.array([names.index(w) for w in wanted])
        self._radius = np.array(drive.radius_m if len(drive.radius_m) == count else drive.radius_m * count)
        self.back = wheels.inverse(jacobian)
        self.jacobian = jacobian
        if self.rolled.shape[1] != count:
            self.rolled = np.zeros((2, count))
            self._may_wrap, self._joint_rate = np.ones(count, np.bool_), np.zeros(count)


def _unwrapped(now: int, before: int) -> int:
    """Tick difference of a counter of 32 or 16 bits that may have wrapped."""
    difference = now - before
    for bits in (32, 16):
        half, whole = 1 << (bits - 1), 1 << bits
        both = (now, before)
        fits = bits == 32 or (max(both) < whole and min(both) >= 0) or (max(both) < half and min(both) >= -half)
        if abs(difference) > half and fits:
            return (difference + half) % whole - half
    return difference
