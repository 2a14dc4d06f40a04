"""Messages of a log as events: which role a message type can play, and how its bytes are read.

The hot types (scan, odometry) are decoded at fixed offsets; everything else goes through rosbags' type system or
json. A payload that cannot be read raises ValueError; the caller counts it.
"""

import math
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pfcli.core.sensor import compass
from pfcli.events import (
    Event,
    Heading,
    Landmarks,
    LinePoints,
    Odometry,
    Pose2,
    Range,
    Scan,
    SourceStamp,
    Steering,
    Truth,
    Twist,
    Wheels,
    YawRate,
)
from pfcli.formats import json_messages
from pfcli.formats.json_messages import heading
from pfcli.formats.schemas import typestore

SECOND = 1_000_000_000
_EVERY_M, _LONGEST_MARKING_M = 0.2, 1000.0

Decoder = Callable[[Any, int, int, int], tuple[Event, str]]
"""(buffer, offset, length, stamp_ns) -> the event and the frame it is given in."""


def stamp_in_header(schema: str) -> bool:
    """Whether a ROS type begins with a std_msgs/Header."""
    return schema not in ("std_msgs/msg/String", "tf2_msgs/msg/TFMessage")


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """Heading of a quaternion."""
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


_U32 = struct.Struct("<I")
_SCAN = struct.Struct("<7fI")
_POSE = struct.Struct("<7d")
_ODOMETRY = struct.Struct("<7d288x6d")
"""Pose, its covariance (left out) and twist."""


def _after_string(buffer: Any, start: int, at: int, end: int) -> tuple[int, int]:
    """(length with the terminator, position after) of the CDR string at `at`; `start` is where alignment begins."""
    at += -(at - start) % 4
    (length,) = _U32.unpack_from(buffer, at)
    if at + 4 + length > end:
        raise ValueError("string longer than its message")
    return length, at + 4 + length


def _scan(buffer: Any, offset: int, length: int, stamp_ns: int) -> tuple[Scan, str]:
    start, end = offset + 4, offset + length
    name, at = _after_string(buffer, start, start + 8, end)
    frame = bytes(buffer[at - name : at - 1]).decode() if name > 1 else ""
    at += -(at - start) % 4
    low, _high, step, _, _, shortest, longest, count = _SCAN.unpack_from(buffer, at)
    if at + 32 + 4 * count > end:
        raise ValueError("field 'ranges' is longer than its message")
    ranges = np.frombuffer(buffer, np.float32, count, at + 32)
    return Scan(stamp_ns, ranges, low, step, shortest, longest, Pose2()), frame


class _OdometryDecoder:
    """Reads odometry; its two frame ids rarely change, so their bytes are compared with the last ones, not parsed again."""

    def __init__(self) -> None:
        self._head = b""
        self._frame = ""
        self._body = 0

    def __call__(self, buffer: Any, offset: int, length: int, stamp_ns: int) -> tuple[Odometry, str]:
        start, end = offset + 4, offset + length
        head = bytes(buffer[start + 8 : start + 8 + len(self._head)])
        if not self._head or head != self._head:
            self._parse(buffer, start, end)
        at = start + self._body
        if at + 680 > end:
            raise ValueError("message is shorter than its type")
        x, y, _, qx, qy, qz, qw, vx, vy, _, _, _, wz = _ODOMETRY.unpack_from(buffer, at)
        return Odometry(stamp_ns, x, y, yaw_of(qx, qy, qz, qw), vx, vy, wz), self._frame

    def _parse(self, buffer: Any, start: int, end: int) -> None:
        self._head = b""
        _, at = _after_string(buffer, start, start + 8, end)
        name, at = _after_string(buffer, start, at, end)
        self._frame = bytes(buffer[at - name : at - 1]).decode() if name > 1 else ""
        self._body = at + -(at - start) % 8 - start
        self._head = bytes(buffer[start + 8 : at])


def _source_stamp(buffer: Any, offset: int, length: int, stamp_ns: int) -> tuple[SourceStamp, str]:
    name, at = _after_string(buffer, offset + 4, offset + 4, offset + length)
    return SourceStamp(stamp_ns, bytes(buffer[at - name : at - 1]).decode()), ""


class Transform(NamedTuple):
    """One geometry_msgs/TransformStamped: parent and child frame, translation (3,), rotation x, y, z, w."""

    stamp_ns: int
    parent: str
    child: str
    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


def transforms(buffer: Any, offset: int, length: int) -> list[Transform]:
    """The transforms of a tf2_msgs/TFMessage; what cannot be read is left out."""
    start, end, found = offset + 4, offset + length, []
    try:
        (count,) = _U32.unpack_from(buffer, start)
        at = start + 4
        for _ in range(count):
            at += -(at - start) % 4
            sec, nsec = struct.unpack_from("<iI", buffer, at)
            name, at = _after_string(buffer, start, at + 8, end)
            parent = bytes(buffer[at - name : at - 1]).decode()
            name, at = _after_string(buffer, start, at, end)
            child = bytes(buffer[at - name : at - 1]).decode()
            at += -(at - start) % 8
            numbers = _POSE.unpack_from(buffer, at)
            at += 56
            if at <= end and all(map(math.isfinite, numbers)):
                found.append(Transform(sec * SECOND + nsec, parent, child, numbers[:3], numbers[3:]))
    except (struct.error, ValueError):
        pass
    return found


def _via_rosbags(schema: str, convert: Callable[[Any, int], tuple[Event, str]]) -> Decoder:
    store = typestore()

    def decode(buffer: Any, offset: int, length: int, stamp_ns: int) -> tuple[Event, str]:
        try:
            message = store.deserialize_cdr(memoryview(buffer)[offset : offset + length], schema)
        except Exception as error:  # rosbags raises whatever its generated code trips over
            raise ValueError(f"is not a {schema} ({type(error).__name__})") from None
        return convert(message, stamp_ns)

    return decode


def _joint_state(m: Any, t: int) -> tuple[Wheels, str]:
    n = len(m.name)
    position = np.asarray(m.position, float) if len(m.position) == n else np.full(n, np.nan)
    velocity = np.asarray(m.velocity, float) if len(m.velocity) == n else np.full(n, np.nan)
    return Wheels(t, tuple(m.name), position, velocity), ""


def _twist_stamped(m: Any, t: int) -> tuple[Twist, str]:
    return Twist(t, m.twist.linear.x, m.twist.linear.y, m.twist.angular.z), ""


def _ackermann(m: Any, t: int) -> tuple[Steering, str]:
    return Steering(t, m.drive.speed, m.drive.steering_angle), ""


def _imu_rate(m: Any, t: int) -> tuple[YawRate, str]:
    return YawRate(t, m.angular_velocity.z), m.header.frame_id


def _imu_heading(m: Any, t: int) -> tuple[Heading, str]:
    if m.orientation_covariance[0] == -1:
        raise ValueError("field 'orientation' is marked absent (orientation_covariance[0] is -1)")
    q = m.orientation
    variance = m.orientation_covariance[8]
    return heading(yaw_of(q.x, q.y, q.z, q.w), math.sqrt(variance) if variance > 0 else math.nan, t), m.header.frame_id


def _field(m: Any, t: int) -> tuple[Heading, str]:
    f = m.magnetic_field
    if not (math.isfinite(f.x) and math.isfinite(f.y)) or f.x == f.y == 0.0:
        raise ValueError("field 'magnetic_field' has no horizontal direction (x and y are NaN or both zero)")
    return Heading(t, compass.heading(f.x, f.y), math.nan), m.header.frame_id


def _range(m: Any, t: int) -> tuple[Range, str]:
    return Range(t, "", m.range, m.min_range, m.max_range, Pose2()), m.header.frame_id


def _pose_stamped(m: Any, t: int) -> tuple[Truth, str]:
    p, q = m.pose.position, m.pose.orientation
    return Truth(t, p.x, p.y, yaw_of(q.x, q.y, q.z, q.w)), m.header.frame_id


def _odometry_truth(m: Any, t: int) -> tuple[Truth, str]:
    return _pose_stamped(type("P", (), {"pose": m.pose.pose, "header": m.header}), t)


def _markings(m: Any, t: int) -> tuple[LinePoints, str]:
    return LinePoints(t, np.concatenate([np.empty((0, 2)), *map(_along, m.segments)])), m.header.frame_id


def _along(segment: Any) -> Any:
    """Points every 20 cm of a line segment."""
    a, b = (np.array([p.x, p.y]) for p in (segment.start, segment.end))
    length = float(np.hypot(*(b - a)))
    if length > _LONGEST_MARKING_M:
        raise ValueError(f"has a marking of {length:g} m")
    count = int(length / _EVERY_M) + 2 if math.isfinite(length) else 0
    return a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)


def _polar(t: int, ids: list[str], xy: list[tuple[float, float]]) -> Landmarks:
    points = np.array(xy, float).reshape(-1, 2)
    bearing = np.array([math.atan2(y, x) for x, y in points])
    return Landmarks(t, tuple(ids), np.hypot(points[:, 0], points[:, 1]), bearing, np.full((len(ids), 2), np.nan))


def _detections(m: Any, t: int) -> tuple[Landmarks, str]:
    xy = [(d.bbox.center.position.x, d.bbox.center.position.y) for d in m.detections]
    return _polar(t, _ids(m.detections), xy), m.header.frame_id


def _ids(detections: Any) -> list[str]:
    """What was detected; `id` is that of a tracker where there is a class."""
    return [(d.results[0].hypothesis.class_id if len(d.results) else "") or d.id for d in detections]


def _crossings(m: Any, t: int) -> tuple[Landmarks, str]:
    xy = [(i.center.position.x, i.center.position.y) for i in m.intersections]
    xy += [(e.center.position.x, e.center.position.y) for e in m.ellipses]
    ids = [{2: "corner", 3: "tee", 4: "cross"}.get(i.num_rays, "") for i in m.intersections] + ["circle"] * len(
        m.ellipses
    )
    return _polar(t, ids, xy), m.header.frame_id


def _goalposts(m: Any, t: int) -> tuple[Landmarks, str]:
    xy = [(p.bb.center.position.x, p.bb.center.position.y) for p in m.posts]
    return _polar(t, ["post"] * len(m.posts), xy), m.header.frame_id


def _detections_2d(m: Any, t: int) -> tuple[Landmarks, str]:
    xy = [(d.bbox.center.position.x, d.bbox.center.position.y) for d in m.detections]
    # polar only in the image's frame: replay takes its centre off before it means anything
    return _polar(t, _ids(m.detections), xy)._replace(pixels=True), ""


_ROS: dict[tuple[str, str], Callable[[Any, int], tuple[Any, str]]] = {
    ("encoders", "sensor_msgs/msg/JointState"): _joint_state,
    ("twist", "geometry_msgs/msg/TwistStamped"): _twist_stamped,
    ("twist", "ackermann_msgs/msg/AckermannDriveStamped"): _ackermann,
    ("imu", "sensor_msgs/msg/Imu"): _imu_rate,
    ("compass", "sensor_msgs/msg/Imu"): _imu_heading,
    ("compass", "sensor_msgs/msg/MagneticField"): _field,
    ("range", "sensor_msgs/msg/Range"): _range,
    ("truth", "geometry_msgs/msg/PoseStamped"): _pose_stamped,
    ("truth", "nav_msgs/msg/Odometry"): _odometry_truth,
    ("lines", "soccer_vision_3d_msgs/msg/MarkingArray"): _markings,
    ("landmarks", "vision_msgs/msg/Detection3DArray"): _detections,
    ("landmarks", "vision_msgs/msg/Detection2DArray"): _detections_2d,
    ("landmarks", "soccer_vision_3d_msgs/msg/GoalpostArray"): _goalposts,
    ("landmarks", "soccer_vision_3d_msgs/msg/MarkingArray"): _crossings,
}


def decoder(role: str, schema: str) -> Decoder:
    """How a message of type `schema` is read in `role`."""
    if (role, schema) == ("scan", "sensor_msgs/msg/LaserScan"):
        return _scan
    if (role, schema) == ("odometry", "nav_msgs/msg/Odometry"):
        return _OdometryDecoder()
    if role == "source_stamp":
        return _source_stamp
    if schema.startswith("pfcli."):
        return json_messages.decoder(schema)
    return _via_rosbags(schema, _ROS[role, schema])
