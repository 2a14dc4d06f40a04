"""Foxglove's schemas, in protobuf and JSON, as the messages that say the same: LaserScan, PoseInFrame, PosesInFrame,
FrameTransform(s), PointCloud, LocationFix.

Source: https://docs.foxglove.dev/docs/visualization/message-schemas. Fields go by name, by the descriptor in the file.
"""

import base64
import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from pfcli.errors import reason
from pfcli.formats import foxglove_protobuf
from pfcli.formats.carried_types import Translate
from pfcli.formats.message_writer import header
from pfcli.formats.reader import Channel
from pfcli.formats.schemas import declaration, typestore

_SECOND = 1_000_000_000
_TRUTH = ("truth", "mocap", "reference", "ground")
_NUMBERS = {1: (2, 1), 2: (1, 1), 3: (4, 2), 4: (3, 2), 5: (6, 4), 6: (5, 4), 7: (7, 4), 8: (8, 8)}
"""Foxglove's type of a point's field -> that of ROS, bytes."""


def is_one(channel: Channel) -> bool:
    """Whether a channel has one of the schemas, in an encoding that is read."""
    return channel.schema_name in _KINDS and channel.encoding in ("protobuf", "json")


def canonical(channel: Channel) -> tuple[Channel, Translate | None]:
    """The channel as pfcli reads it, and what its payloads must go through."""
    name, convert = _KINDS[channel.schema_name]
    if name == "pfcli.Odometry" and any(word in channel.topic.lower() for word in _TRUTH):
        name, convert = "geometry_msgs/msg/PoseStamped", _pose_stamped
    read = foxglove_protobuf.reader(channel) if channel.encoding == "protobuf" else json.loads
    encoding, kind, text = declaration(name)
    ours = channel._replace(schema_name=name, encoding=encoding, schema_encoding=kind, schema=text)

    def translate(payload: bytes) -> bytes:
        try:
            message = convert(read(payload))
            return message if isinstance(message, bytes) else bytes(typestore().serialize_cdr(message, name))
        except Exception as error:  # protobuf and the generated code of rosbags raise errors of their own
            raise ValueError(f"is not a {channel.schema_name} ({reason(error)})") from None

    return ours, translate


def _get(message: Any, name: str, default: Any = None) -> Any:
    """A field of a JSON object or of a protobuf message."""
    found = message.get(name) if isinstance(message, dict) else getattr(message, name, None)
    return default if found is None else found


def _stamp(message: Any) -> int:
    """Raises ValueError where there is none."""
    stamp = _get(message, "timestamp")
    if stamp is None:
        raise ValueError("it has no field 'timestamp'")
    if isinstance(stamp, str):
        return int(np.datetime64(stamp.rstrip("Z"), "ns").astype(np.int64))
    seconds = _get(stamp, "sec", _get(stamp, "seconds", 0))
    rest = next((v for v in (_get(stamp, n) for n in ("nsec", "nanos", "nanosec")) if v is not None), 0)
    return int(seconds) * _SECOND + int(rest)


def _vector(message: Any, names: str = "xyz") -> tuple[float, ...]:
    return tuple(float(_get(message, name, 0.0)) for name in names) if message is not None else (0.0,) * len(names)


def _rotation(message: Any) -> tuple[float, ...]:
    """A quaternion x, y, z, w; one that is not set turns nothing."""
    found = _vector(message, "xyzw")
    return found if any(found) else (0.0, 0.0, 0.0, 1.0)


def _yaw(q: tuple[float, ...]) -> float:
    x, y, z, w = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _turn(message: Any) -> float:
    """How the field `pose` of a scan or cloud turns it. Raises ValueError where it does more."""
    pose = _get(message, "pose")
    q = _rotation(_get(pose, "orientation")) if pose is not None else (0.0, 0.0, 0.0, 1.0)
    if pose is not None and (any(_vector(_get(pose, "position"))) or abs(q[0]) + abs(q[1]) > 1e-6):
        raise ValueError("its field 'pose' shifts or tilts it; give that as a transform, or --extrinsic")
    return _yaw(q)


def _laser_scan(m: Any) -> Any:
    ranges = np.array([math.inf if v is None else v for v in _get(m, "ranges", [])], np.float32)
    low, high, turn = float(_get(m, "start_angle", 0.0)), float(_get(m, "end_angle", 0.0)), _turn(m)
    step = (high - low) / (ranges.size - 1) if ranges.size > 1 else 0.0
    empty = np.empty(0, np.float32)
    kind = typestore().types["sensor_msgs/msg/LaserScan"]
    limits = (0.0, math.inf)
    head = header(_stamp(m), str(_get(m, "frame_id", "")))
    return kind(head, low + turn, high + turn, step, 0.0, 0.0, *limits, ranges, empty)


def _pose(m: Any) -> tuple[Any, Any]:
    """Stamped message and its only pose."""
    poses = _get(m, "poses")
    pose = _get(m, "pose")
    if pose is None and poses is not None:
        if len(poses) != 1:
            raise ValueError(f"it holds {len(poses)} poses; one is needed")
        pose = poses[0]
    if pose is None:
        raise ValueError("it has no field 'pose'")
    return _get(pose, "position"), _get(pose, "orientation")


def _odometry(m: Any) -> bytes:
    position, orientation = _pose(m)
    x, y, _ = _vector(position)
    values = {"stamp_ns": _stamp(m), "x_m": x, "y_m": y, "yaw_rad": _yaw(_rotation(orientation))}
    return json.dumps(values).encode()


def _pose_stamped(m: Any) -> Any:
    types = typestore().types
    position, orientation = _pose(m)
    point = types["geometry_msgs/msg/Point"](*_vector(position))
    turned = types["geometry_msgs/msg/Quaternion"](*_rotation(orientation))
    head = header(_stamp(m), str(_get(m, "frame_id", "")))
    return types["geometry_msgs/msg/PoseStamped"](head, types["geometry_msgs/msg/Pose"](point, turned))


def _transform(m: Any) -> Any:
    types = typestore().types
    moved = types["geometry_msgs/msg/Vector3"](*_vector(_get(m, "translation")))
    turned = types["geometry_msgs/msg/Quaternion"](*_rotation(_get(m, "rotation")))
    head = header(_stamp(m), str(_get(m, "parent_frame_id", "")))
    child = str(_get(m, "child_frame_id", ""))
    return types["geometry_msgs/msg/TransformStamped"](head, child, types["geometry_msgs/msg/Transform"](moved, turned))


def _transforms(m: Any) -> Any:
    return typestore().types["tf2_msgs/msg/TFMessage"]([_transform(t) for t in _get(m, "transforms", [])])


def _one_transform(m: Any) -> Any:
    return typestore().types["tf2_msgs/msg/TFMessage"]([_transform(m)])


def _point_cloud(m: Any) -> Any:
    if abs(_turn(m)) > 1e-9:
        raise ValueError("its field 'pose' turns it; give that as a transform, or --extrinsic")
    types, fields = typestore().types, []
    for field in _get(m, "fields", []):
        kind, _ = _NUMBERS[int(_get(field, "type", 0))]
        name, offset = str(_get(field, "name", "")), int(_get(field, "offset", 0))
        fields.append(types["sensor_msgs/msg/PointField"](name, offset, kind, 1))
    data = _get(m, "data", b"")
    data = base64.b64decode(data) if isinstance(data, str) else bytes(data)
    stride = int(_get(m, "point_stride", 0))
    if stride <= 0 or len(data) % stride:
        raise ValueError("its field 'point_stride' does not divide its data")
    count = len(data) // stride
    head = header(_stamp(m), str(_get(m, "frame_id", "")))
    cells = np.frombuffer(data, np.uint8)
    return types["sensor_msgs/msg/PointCloud2"](head, 1, count, fields, False, stride, stride * count, cells, False)


def _location(m: Any) -> Any:
    types = typestore().types
    covariance = np.zeros(9)
    given = np.asarray(list(_get(m, "position_covariance", [])), float)
    covariance[: given.size] = given[:9]
    status = types["sensor_msgs/msg/NavSatStatus"](0, 1)
    place = [float(_get(m, name, 0.0)) for name in ("latitude", "longitude", "altitude")]
    head = header(_stamp(m), str(_get(m, "frame_id", "")))
    return types["sensor_msgs/msg/NavSatFix"](
        head, status, *place, covariance, int(_get(m, "position_covariance_type", 0))
    )


_KINDS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "foxglove.LaserScan": ("sensor_msgs/msg/LaserScan", _laser_scan),
    "foxglove.PoseInFrame": ("pfcli.Odometry", _odometry),
    "foxglove.PosesInFrame": ("pfcli.Odometry", _odometry),
    "foxglove.FrameTransform": ("tf2_msgs/msg/TFMessage", _one_transform),
    "foxglove.FrameTransforms": ("tf2_msgs/msg/TFMessage", _transforms),
    "foxglove.PointCloud": ("sensor_msgs/msg/PointCloud2", _point_cloud),
    "foxglove.LocationFix": ("sensor_msgs/msg/NavSatFix", _location),
}
"""Schema -> the type of which it becomes one."""
