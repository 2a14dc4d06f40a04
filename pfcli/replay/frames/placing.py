"""A sensor's reading as an event in the robot's base frame."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pfcli.core import rigid
from pfcli.core.grid.scan_projection import projected, sliced
from pfcli.core.rigid import Motion
from pfcli.core.sensor import compass
from pfcli.dropped import Dropped
from pfcli.errors import LogError, printable
from pfcli.events import Heading, Landmarks, Odometry, Pose2, Range, Scan, Truth, Twist, YawRate
from pfcli.formats.raw_readings import Attitude, BodyPose, BodySpeed, Cloud, Gyroscope, Magnetometer, Spots
from pfcli.replay.frames.robot_frames import STEEPEST_RAD, Mount
from pfcli.replay.settings import Band

BEARINGS = 720
"""Of the virtual scan that is made of a point cloud."""
_SHOWN_DEG = 0.1


class Reading(NamedTuple):
    """A decoded message: where it came from (for messages), its topic, its frame, and where that sits."""

    where: str
    topic: str
    frame: str
    mount: Mount


def scan(event: Scan, at: Reading, band: Band, dropped: Dropped) -> Scan:
    """A scan in the base frame; of a scanner that leans, the end points seen from above. Raises LogError where it sees no
    plane."""
    mount = at.mount
    if mount.level:
        if not mount.flipped:
            return event._replace(mount=mount.pose, topic=at.topic)
        low, step = -event.angle_min_rad, -event.angle_increment_rad
        return event._replace(mount=mount.pose, topic=at.topic, angle_min_rad=low, angle_increment_rad=step)
    if mount.tilt_rad > STEEPEST_RAD:
        raise LogError(
            f"{at.where}: the scanner's plane leans by {math.degrees(mount.tilt_rad):.1f} deg (frame"
            f" {printable(at.frame)!r}), so it sees no outline of the walls; more than {math.degrees(STEEPEST_RAD):.0f} deg is"
            f" refused; if it is level in truth, give --extrinsic base_link:{printable(at.frame)}=x,y,yaw"
        )
    heights = (min(band.low_m, mount.height_m / 2), band.high_m)
    angles = (event.angle_min_rad, event.angle_increment_rad)
    usable = (event.range_min_m, event.range_max_m)
    ranges, bearings, off = projected(
        event.ranges_m, angles, usable, mount.motion[:3, :3].copy(), mount.height_m, heights
    )
    if off:
        dropped.read["beams that met floor or ceiling"] += off
    pose = Pose2(mount.pose.x_m, mount.pose.y_m, 0.0)
    return event._replace(topic=at.topic, ranges_m=ranges, range_min_m=0.0, mount=pose, bearings_rad=bearings)


def cloud(event: Cloud, at: Reading, band: Band, dropped: Dropped) -> Scan:
    """The nearest points of a cloud between two heights, all around, as a scan."""
    mount = at.mount
    motion = mount.motion.copy()
    motion[2, 3] = mount.height_m
    ranges, bearings, used = sliced(event.points_m, motion, band, BEARINGS)
    if used == 0:
        dropped.read["clouds without a point between the heights of --slice-m"] += 1
    return Scan(
        stamp_ns=event.stamp_ns,
        ranges_m=ranges,
        angle_min_rad=-math.pi,
        angle_increment_rad=2 * math.pi / BEARINGS,
        range_min_m=0.0,
        range_max_m=math.inf,
        mount=Pose2(mount.pose.x_m, mount.pose.y_m, 0.0),
        bearings_rad=bearings,
        topic=at.topic,
    )


def finder(event: Range, at: Reading, dropped: Dropped) -> Range | None:
    """What a range finder reads, seen from above; one that looks at the floor says nothing about walls."""
    mount = at.mount
    ahead = mount.motion[:3, 0]
    lean = math.asin(max(-1.0, min(1.0, float(ahead[2]))))
    placed = event._replace(topic=at.topic, mount=mount.pose)
    if abs(lean) < 1e-3:
        return placed
    if abs(lean) > STEEPEST_RAD:
        dropped.add(
            "range finder that looks up or down",
            f"{at.where}: frame {printable(at.frame)!r} looks {math.degrees(lean):.0f} deg up; its readings are left out",
        )
        return None
    flat = math.cos(lean)
    met_floor = lean < 0 < mount.height_m <= -event.range_m * math.sin(lean) and math.isfinite(event.range_m)
    value = math.nan if met_floor else event.range_m * flat
    dropped.read["beams that met floor or ceiling"] += met_floor
    return placed._replace(range_m=value, range_min_m=event.range_min_m * flat, range_max_m=event.range_max_m * flat)


def yaw_rate(event: Gyroscope, mount: Mount) -> YawRate:
    """The turn rate about the base's vertical."""
    if mount.level and not mount.flipped:
        return YawRate(event.stamp_ns, event.rates_radps[2])
    return YawRate(event.stamp_ns, float(mount.motion[2, :3] @ np.array(event.rates_radps)))


def heading(event: Attitude, mount: Mount) -> Heading:
    """The robot's heading, of an orientation of the sensor."""
    turned = rigid.from_quaternion((0.0, 0.0, 0.0), event.rotation)
    base = turned[:3, :3] @ mount.motion[:3, :3].T
    return Heading(event.stamp_ns, math.atan2(base[1, 0], base[0, 0]), event.sigma_rad)


def compass_heading(event: Magnetometer, mount: Mount) -> Heading:
    """The robot's heading, of the field along its own axes."""
    x, y, _ = (mount.motion[:3, :3] @ np.array(event.field)).tolist()
    if x == y == 0.0:
        raise ValueError("field 'magnetic_field' has no horizontal direction")
    return Heading(event.stamp_ns, compass.heading(x, y), math.nan)


def velocity(event: BodySpeed, mount: Mount) -> Twist:
    """The base's speeds, of a frame that is fixed on the robot: v + w x lever."""
    linear, angular = _speeds(mount.motion, event.linear_mps, event.angular_radps)
    return Twist(event.stamp_ns, float(linear[0]), float(linear[1]), float(angular[2]))


def _speeds(motion: Motion, linear: Any, angular: Any) -> tuple[Any, Any]:
    turned = motion[:3, :3] @ np.array(angular)
    return motion[:3, :3] @ np.array(linear) - np.cross(turned, motion[:3, 3]), turned


def pose_of(event: BodyPose, mount: Mount) -> Motion:
    """The base in the frame that a body's pose is given in; the body sits on the robot at `mount`."""
    return rigid.from_quaternion(event.position_m, event.rotation) @ rigid.inverse(mount.motion)


class Carried:
    """Odometry of a body on the robot (a camera) as odometry of the base: how the base has moved since the first message,
    in the plane in which it stood then, whichever way the body's own world lies."""

    def __init__(self) -> None:
        self._first: Motion | None = None

    def __call__(self, event: BodyPose, mount: Mount) -> Odometry:
        """The base's odometry at this message."""
        base = pose_of(event, mount)
        if self._first is None:
            self._first = rigid.inverse(base)
        moved = self._first @ base
        linear, angular = _speeds(mount.motion, event.linear_mps, event.angular_radps)
        return Odometry(
            stamp_ns=event.stamp_ns,
            x_m=float(moved[0, 3]),
            y_m=float(moved[1, 3]),
            yaw_rad=rigid.yaw_of(moved),
            vx_mps=float(linear[0]),
            vy_mps=float(linear[1]),
            yaw_rate_radps=float(angular[2]),
        )


def truth(event: BodyPose, mount: Mount) -> Truth:
    """The base's pose, of that of a body on the robot."""
    base = pose_of(event, mount)
    return Truth(event.stamp_ns, float(base[0, 3]), float(base[1, 3]), rigid.yaw_of(base))


def spots(event: Spots, mount: Mount, polar: Callable[[Spots], Landmarks]) -> Landmarks:
    """Detected places seen from above, in the base frame."""
    if event.points_m.size == 0:
        return polar(event)
    return polar(event._replace(points_m=event.points_m @ mount.motion[:3, :3].T + mount.motion[:3, 3]))


class Gravity:
    """What an IMU's own accelerometer says of which way is up, over its first readings."""

    _ENOUGH, _G, _OFF = 50, 9.81, 2.0

    def __init__(self) -> None:
        self._sum, self._count = np.zeros(3), 0

    def hear(self, event: Gyroscope) -> None:
        """Take up a reading's acceleration, where it is about that of gravity."""
        force = np.array(event.acceleration_mps2)
        if self._count < self._ENOUGH and abs(float(np.sqrt(force @ force)) - self._G) < self._OFF:
            self._sum, self._count = self._sum + force, self._count + 1

    @property
    def up(self) -> Any:
        """The direction upwards along the sensor's axes (3,), None before anything was heard."""
        return None if self._count == 0 else self._sum / np.sqrt(self._sum @ self._sum)


def upright(event: Gyroscope, gravity: Gravity) -> YawRate | None:
    """The turn rate about the vertical of an IMU that nothing places: by gravity; None where that is not known."""
    gravity.hear(event)
    up = gravity.up
    return None if up is None else YawRate(event.stamp_ns, float(up @ np.array(event.rates_radps)))
