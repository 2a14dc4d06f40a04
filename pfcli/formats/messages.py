"""Messages of a log as events: which role a message type can play, and how its bytes are read.

The hot types (scan, odometry) are decoded at fixed offsets; everything else goes through rosbags' type system or
json. A payload that cannot be read raises ValueError; the caller counts it.
"""

import math
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pfcli.core.rigid import unit
from pfcli.events import (
    EVENLY,
    Event,
    Landmarks,
    LinePoints,
    Odometry,
    Pose2,
    Range,
    Scan,
    SourceStamp,
    Steering,
    Truth,
    Wheels,
)
from pfcli.formats import json_messages
from pfcli.formats.point_cloud import points_of
from pfcli.formats.raw_readings import (
    UNKNOWN,
    Attitude,
    BodyPose,
    BodySpeed,
    Cloud,
    Gyroscope,
    Magnetometer,
    Quaternion,
    Spots,
    Vector,
)
from pfcli.formats.schemas import typestore

SECOND = 1_000_000_000
_EVERY_M, _LONGEST_MARKING_M = 0.2, 1000.0

Raw = Gyroscope | Attitude | Magnetometer | BodyPose | BodySpeed | Cloud | Spots
"""What is no event before its sensor's place on the robot is known."""

Decoder = Callable[[Any, int, int, int], tuple[Event | Raw, str]]
"""(buffer, offset, length, stamp_ns) -> the reading and the frame it is given in."""

_ABSENT = -1.0
"""First entry of a covariance that marks its field as not there (sensor_msgs/Imu, and many odometries)."""


def stamp_in_header(schema: str) -> bool:
    """Whether a ROS type begins with a std_msgs/Header."""
    return schema not in ("std_msgs/msg/String", "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/Twist")


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """Heading of a quaternion of any length; NaN where it is all zero."""
    square = x * x + y * y + z * z + w * w
    if abs(square - 1.0) > 1e-6:
        if square < 1e-12:
            return math.nan
        x, y, z, w = unit((x, y, z, w))
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


_U32 = struct.Struct("<I")
_SCAN = struct.Struct("<7fI")
_POSE = struct.Struct("<7d")
_ODOMETRY = struct.Struct("<8d280x7d")
"""Pose and twist, each with the first entry of its covariance."""


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
    low, _high, step, increment, period, shortest, longest, count = _SCAN.unpack_from(buffer, at)
    if at + 32 + 4 * count > end:
        raise ValueError("field 'ranges' is longer than its message")
    ranges = np.frombuffer(buffer, np.float32, count, at + 32)
    return Scan(stamp_ns, ranges, low, step, shortest, longest, Pose2(), EVENLY, *_times(increment, period)), frame


def _times(increment_s: float, period_s: float) -> tuple[float, float]:
    """Time between beams and between scans; 0 for what is no time."""
    return increment_s if 0.0 < increment_s < 1.0 else 0.0, period_s if 0.0 < period_s < 60.0 else 0.0


class _OdometryDecoder:
    """Reads odometry; its two frame ids rarely change, so their bytes are compared with the last ones, not parsed again.

    whole: all three dimensions of it, for a body that is not the base.
    """

    def __init__(self, whole: bool = False) -> None:
        self._head = b""
        self._frame = ""
        self._body = 0
        self._whole = whole

    def __call__(self, buffer: Any, offset: int, length: int, stamp_ns: int) -> tuple[Odometry | BodyPose, str]:
        start, end = offset + 4, offset + length
        head = bytes(buffer[start + 8 : start + 8 + len(self._head)])
        if not self._head or head != self._head:
            self._parse(buffer, start, end)
        at = start + self._body
        if at + 680 > end:
            raise ValueError("message is shorter than its type")
        x, y, z, qx, qy, qz, qw, pose, vx, vy, vz, wx, wy, wz, twist = _ODOMETRY.unpack_from(buffer, at)
        if pose == _ABSENT:
            x = y = math.nan
        if twist == _ABSENT:
            vx = vy = vz = wx = wy = wz = math.nan
        if self._whole:
            rotation = _turn((qx, qy, qz, qw))
            return BodyPose(stamp_ns, (x, y, z), rotation, (vx, vy, vz), (wx, wy, wz)), self._frame
        return Odometry(stamp_ns, x, y, yaw_of(qx, qy, qz, qw), vx, vy, wz), self._frame

    def _parse(self, buffer: Any, start: int, end: int) -> None:
        self._head = b""
        _, at = _after_string(buffer, start, start + 8, end)
        name, at = _after_string(buffer, start, at, end)
        self._frame = bytes(buffer[at - name : at - 1]).decode().lstrip("/") if name > 1 else ""
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


def _turn(rotation: Quaternion) -> Quaternion:
    """The quaternion of length 1. Raises ValueError for one that is all zero."""
    try:
        return unit(rotation)
    except ValueError:
        raise ValueError("field 'orientation' is all zero or not finite: a quaternion that says nothing") from None


def _via_rosbags(schema: str, convert: Callable[[Any, int], tuple[Event | Raw, str]]) -> Decoder:
    store = typestore()

    def decode(buffer: Any, offset: int, length: int, stamp_ns: int) -> tuple[Event | Raw, str]:
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


def _vector(v: Any) -> Vector:
    return v.x, v.y, v.z


def _twist_stamped(m: Any, t: int) -> tuple[BodySpeed, str]:
    return BodySpeed(t, _vector(m.twist.linear), _vector(m.twist.angular)), m.header.frame_id


def _twist_covariance(m: Any, t: int) -> tuple[BodySpeed, str]:
    if m.twist.covariance[0] == _ABSENT:
        raise ValueError("field 'twist' is marked absent (covariance[0] is -1)")
    return BodySpeed(t, _vector(m.twist.twist.linear), _vector(m.twist.twist.angular)), m.header.frame_id


def _twist(m: Any, t: int) -> tuple[BodySpeed, str]:
    return BodySpeed(t, _vector(m.linear), _vector(m.angular)), ""


def _ackermann(m: Any, t: int) -> tuple[Steering, str]:
    return Steering(t, m.drive.speed, m.drive.steering_angle), ""


def _imu_rate(m: Any, t: int) -> tuple[Gyroscope, str]:
    if m.angular_velocity_covariance[0] == _ABSENT:
        raise ValueError(
            "field 'angular_velocity' is marked absent (angular_velocity_covariance[0] is -1): the sensor has no gyroscope"
        )
    pulled = UNKNOWN if m.linear_acceleration_covariance[0] == _ABSENT else _vector(m.linear_acceleration)
    return Gyroscope(t, _vector(m.angular_velocity), pulled), m.header.frame_id


def _imu_heading(m: Any, t: int) -> tuple[Attitude, str]:
    if m.orientation_covariance[0] == _ABSENT:
        raise ValueError("field 'orientation' is marked absent (orientation_covariance[0] is -1)")
    q = m.orientation
    variance = m.orientation_covariance[8]
    return Attitude(
        t, _turn((q.x, q.y, q.z, q.w)), math.sqrt(variance) if variance > 0 else math.nan
    ), m.header.frame_id


def _field(m: Any, t: int) -> tuple[Magnetometer, str]:
    f = m.magnetic_field
    if not (math.isfinite(f.x) and math.isfinite(f.y)) or f.x == f.y == 0.0:
        raise ValueError("field 'magnetic_field' has no horizontal direction (x and y are NaN or both zero)")
    return Magnetometer(t, (f.x, f.y, f.z if math.isfinite(f.z) else 0.0)), m.header.frame_id


def _range(m: Any, t: int) -> tuple[Range, str]:
    return Range(t, "", m.range, m.min_range, m.max_range, Pose2()), m.header.frame_id


def _pose_stamped(m: Any, t: int) -> tuple[Truth, str]:
    p, q = m.pose.position, m.pose.orientation
    return Truth(t, p.x, p.y, yaw_of(q.x, q.y, q.z, q.w)), m.header.frame_id


def _pose_covariance(m: Any, t: int) -> tuple[Truth, str]:
    if m.pose.covariance[0] == _ABSENT:
        raise ValueError("field 'pose' is marked absent (covariance[0] is -1)")
    p, q = m.pose.pose.position, m.pose.pose.orientation
    return Truth(t, p.x, p.y, yaw_of(q.x, q.y, q.z, q.w)), m.header.frame_id


def _as_odometry(convert: Callable[[Any, int], tuple[Truth, str]]) -> Callable[[Any, int], tuple[Odometry, str]]:
    """Poses of the base, which have no child frame, as odometry."""
    return lambda m, t: (Odometry(*convert(m, t)[0]), "")


class _NavSat:
    """Fixes of a satellite receiver as places on the plane that touches the earth at the first one: x east, y north (m).

    No heading, and no height. WGS 84; within 10 km of the first fix the plane is right to 1 cm per km.
    """

    _RADIUS_M, _SQUASHED = 6378137.0, 6.69437999014e-3

    def __init__(self) -> None:
        self._first: tuple[float, float] | None = None
        self._per_rad = (0.0, 0.0)

    def __call__(self, m: Any, t: int) -> tuple[Truth, str]:
        if m.status.status < 0:
            raise ValueError("field 'status' says that there is no fix")
        latitude, longitude = math.radians(m.latitude), math.radians(m.longitude)
        if self._first is None:
            self._first = latitude, longitude
            bent = 1.0 - self._SQUASHED * math.sin(latitude) ** 2
            across = self._RADIUS_M / math.sqrt(bent)
            self._per_rad = across * math.cos(latitude), across * (1.0 - self._SQUASHED) / bent
        east = math.remainder(longitude - self._first[1], 2 * math.pi) * self._per_rad[0]
        return Truth(t, east, (latitude - self._first[0]) * self._per_rad[1], math.nan), m.header.frame_id


def _echoes(m: Any, t: int) -> tuple[Scan, str]:
    """Of several echoes of a beam the strongest, or the first where the log has no intensities."""
    ranges = np.full(len(m.ranges), np.inf, np.float32)
    for k, beam in enumerate(m.ranges):
        echoes = np.asarray(beam.echoes, np.float32)
        good = np.flatnonzero(np.isfinite(echoes) & (echoes >= m.range_min) & (echoes <= m.range_max))
        if good.size:
            strengths = np.asarray(m.intensities[k].echoes) if k < len(m.intensities) else np.empty(0)
            best = good[np.argmax(strengths[good])] if strengths.size == echoes.size else good[0]
            ranges[k] = echoes[best]
    low, step = m.angle_min, m.angle_increment
    times = _times(m.time_increment, m.scan_time)
    return Scan(t, ranges, low, step, m.range_min, m.range_max, Pose2(), EVENLY, *times), m.header.frame_id


def _cloud(m: Any, t: int) -> tuple[Cloud, str]:
    return Cloud(t, points_of(m)), m.header.frame_id


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


def polar(spots: Spots) -> Landmarks:
    """Places as landmarks: range and bearing, seen from above."""
    x, y = spots.points_m[:, 0], spots.points_m[:, 1]
    bearing = np.array([math.atan2(b, a) for a, b in zip(x.tolist(), y.tolist(), strict=True)])
    return Landmarks(spots.stamp_ns, spots.ids, np.hypot(x, y), bearing, np.full((len(spots.ids), 2), np.nan))


def _spots(t: int, ids: list[str], places: list[Any]) -> Spots:
    """places: points with x, y and, where they have one, z."""
    rows = [(p.x, p.y, getattr(p, "z", 0.0)) for p in places]
    return Spots(t, tuple(ids), np.array(rows, float).reshape(-1, 3))


def _detections(m: Any, t: int) -> tuple[Spots, str]:
    return _spots(t, _ids(m.detections), [d.bbox.center.position for d in m.detections]), m.header.frame_id


def _ids(detections: Any) -> list[str]:
    """What was detected; `id` is that of a tracker where there is a class."""
    return [(d.results[0].hypothesis.class_id if len(d.results) else "") or d.id for d in detections]


def _crossings(m: Any, t: int) -> tuple[Spots, str]:
    places = [i.center.position for i in m.intersections] + [e.center.position for e in m.ellipses]
    ids = [{2: "corner", 3: "tee", 4: "cross"}.get(i.num_rays, "") for i in m.intersections] + ["circle"] * len(
        m.ellipses
    )
    return _spots(t, ids, places), m.header.frame_id


def _goalposts(m: Any, t: int) -> tuple[Spots, str]:
    return _spots(t, ["post"] * len(m.posts), [p.bb.center.position for p in m.posts]), m.header.frame_id


def _detections_2d(m: Any, t: int) -> tuple[Landmarks, str]:
    # polar only in the image's frame: replay takes its centre off before it means anything
    seen = polar(_spots(t, _ids(m.detections), [d.bbox.center.position for d in m.detections]))
    return seen._replace(pixels=True), ""


_ROS: dict[tuple[str, str], Callable[[Any, int], tuple[Any, str]]] = {
    ("encoders", "sensor_msgs/msg/JointState"): _joint_state,
    ("odometry", "geometry_msgs/msg/PoseStamped"): _as_odometry(_pose_stamped),
    ("odometry", "geometry_msgs/msg/PoseWithCovarianceStamped"): _as_odometry(_pose_covariance),
    ("twist", "geometry_msgs/msg/TwistStamped"): _twist_stamped,
    ("twist", "geometry_msgs/msg/TwistWithCovarianceStamped"): _twist_covariance,
    ("twist", "geometry_msgs/msg/Twist"): _twist,
    ("scan", "sensor_msgs/msg/MultiEchoLaserScan"): _echoes,
    ("scan", "sensor_msgs/msg/PointCloud2"): _cloud,
    ("twist", "ackermann_msgs/msg/AckermannDriveStamped"): _ackermann,
    ("imu", "sensor_msgs/msg/Imu"): _imu_rate,
    ("compass", "sensor_msgs/msg/Imu"): _imu_heading,
    ("compass", "sensor_msgs/msg/MagneticField"): _field,
    ("range", "sensor_msgs/msg/Range"): _range,
    ("truth", "geometry_msgs/msg/PoseStamped"): _pose_stamped,
    ("truth", "geometry_msgs/msg/PoseWithCovarianceStamped"): _pose_covariance,
    ("lines", "soccer_vision_3d_msgs/msg/MarkingArray"): _markings,
    ("landmarks", "vision_msgs/msg/Detection3DArray"): _detections,
    ("landmarks", "vision_msgs/msg/Detection2DArray"): _detections_2d,
    ("landmarks", "soccer_vision_3d_msgs/msg/GoalpostArray"): _goalposts,
    ("landmarks", "soccer_vision_3d_msgs/msg/MarkingArray"): _crossings,
}


def decoder(role: str, schema: str, whole: bool = False) -> Decoder:
    """How a message of type `schema` is read in `role`; whole: odometry in space, as a `BodyPose`."""
    if (role, schema) == ("scan", "sensor_msgs/msg/LaserScan"):
        return _scan
    if schema == "nav_msgs/msg/Odometry":
        return _OdometryDecoder(whole) if whole or role == "odometry" else _odometry_truth()
    if (role, schema) == ("truth", "sensor_msgs/msg/NavSatFix"):
        return _via_rosbags(schema, _NavSat())
    if role == "source_stamp":
        return _source_stamp
    if schema.startswith("pfcli."):
        return json_messages.decoder(schema)
    return _via_rosbags(schema, _ROS[role, schema])


def _odometry_truth() -> Decoder:
    """Odometry of the base as truth."""
    read = _OdometryDecoder()

    def decode(buffer: Any, offset: int, length: int, stamp_ns: int) -> tuple[Truth, str]:
        event, frame = read(buffer, offset, length, stamp_ns)
        return Truth(*event[:4]), frame

    return decode
