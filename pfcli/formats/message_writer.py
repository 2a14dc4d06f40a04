"""Readings as the messages that hold them: CDR by the ROS 2 definitions, and JSON by the schemas `pfcli.*`."""

import json
import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.events import Heading, Landmarks, LinePoints, Odometry, Pose2, Scan, Ticks, Truth, Twist
from pfcli.formats.schemas import typestore

_HEAD = b"\x00\x01\x00\x00"
_SECOND = 1_000_000_000


class MessageWriter:
    """Encodes readings; where the messages go is the matter of `raw`."""

    def raw(self, topic: str, schema: str, stamp_ns: int, payload: bytes) -> None:
        """Append a payload whose encoding follows its type: `pfcli.*` is JSON, all else CDR."""
        raise NotImplementedError

    def message(self, topic: str, schema: str, stamp_ns: int, message: Any) -> None:
        """Append a message object of rosbags' type system."""
        self.raw(topic, schema, stamp_ns, bytes(typestore().serialize_cdr(message, schema)))

    def json(self, topic: str, schema: str, stamp_ns: int, **fields: object) -> None:
        """Append a `pfcli.*` message."""
        text = json.dumps({"stamp_ns": stamp_ns, **fields}, allow_nan=False)
        self.raw(topic, schema, stamp_ns, text.encode())

    def event(self, event: Odometry | Twist | Ticks | Heading | Scan | LinePoints | Landmarks | Truth) -> None:
        """Append an event as the message that holds it, on its usual topic."""
        if isinstance(event, Truth):
            self.pose(event.stamp_ns, event[1:4])
        elif isinstance(event, Odometry):
            self.odometry(event)
        elif isinstance(event, Twist):
            self.twist(event)
        elif isinstance(event, Ticks):
            self.ticks(event)
        elif isinstance(event, Heading):
            self.heading(event)
        elif isinstance(event, Scan):
            self.scan(event)
        elif isinstance(event, LinePoints):
            self.line_points(event)
        else:
            self.landmarks(event)

    def odometry(self, o: Odometry, topic: str = "/odom") -> None:
        """Append nav_msgs/Odometry (odom -> base_link)."""
        body = _header(o.stamp_ns, "odom")
        body += _string("base_link", len(body))
        body += bytes(-len(body) % 8)
        twist = [v if math.isfinite(v) else 0.0 for v in (o.vx_mps, o.vy_mps, o.yaw_rate_radps)]
        numbers = [o.x_m, o.y_m, 0.0, 0.0, 0.0, math.sin(o.yaw_rad / 2), math.cos(o.yaw_rad / 2), *[0.0] * 36]
        numbers += [twist[0], twist[1], 0.0, 0.0, 0.0, twist[2], *[0.0] * 36]
        self.raw(topic, "nav_msgs/msg/Odometry", o.stamp_ns, _HEAD + body + struct.pack("<85d", *numbers))

    def ticks(self, ticks: Ticks, topic: str = "/encoders") -> None:
        """Append pfcli.WheelEncoders."""
        values = {"names": list(ticks.names), "ticks": ticks.ticks.tolist()}
        turn = {"ticks_per_turn": ticks.ticks_per_turn, "cumulative": ticks.cumulative}
        self.json(topic, "pfcli.WheelEncoders", ticks.stamp_ns, **values, **turn)

    def scan(self, scan: Scan, topic: str = "/scan", frame: str = "laser") -> None:
        """Append sensor_msgs/LaserScan."""
        body = _header(scan.stamp_ns, frame)
        body += bytes(-len(body) % 4)
        n = scan.ranges_m.size
        top = scan.angle_min_rad + (n - 1) * scan.angle_increment_rad
        body += struct.pack(
            "<7fI", scan.angle_min_rad, top, scan.angle_increment_rad, 0, 0, scan.range_min_m, scan.range_max_m, n
        )
        body += np.asarray(scan.ranges_m, "<f4").tobytes() + struct.pack("<I", 0)
        self.raw(topic, "sensor_msgs/msg/LaserScan", scan.stamp_ns, _HEAD + body)

    def cloud(
        self, stamp_ns: int, points_m: NDArray[np.floating], topic: str = "/points", frame: str = "laser"
    ) -> None:
        """Append sensor_msgs/PointCloud2 of points (rows, columns, 3), organised."""
        kind, types = "sensor_msgs/msg/PointCloud2", typestore().types
        rows, columns, _ = points_m.shape
        fields = [types["sensor_msgs/msg/PointField"](name, 4 * k, 7, 1) for k, name in enumerate("xyz")]
        data = np.frombuffer(np.ascontiguousarray(points_m, "<f4").tobytes(), np.uint8)
        made = types[kind](header(stamp_ns, frame), rows, columns, fields, False, 12, 12 * columns, data, False)
        self.message(topic, kind, stamp_ns, made)

    def heading(self, heading: Heading, topic: str = "/compass") -> None:
        """Append pfcli.Heading."""
        self.json(topic, "pfcli.Heading", heading.stamp_ns, yaw_rad=round(heading.yaw_rad, 4))

    def twist(self, twist: Twist, topic: str = "/cmd_vel") -> None:
        """Append pfcli.Twist."""
        speeds = {"vx_mps": twist.vx_mps, "vy_mps": twist.vy_mps, "yaw_rate_radps": twist.yaw_rate_radps}
        self.json(topic, "pfcli.Twist", twist.stamp_ns, **speeds)

    def landmarks(self, seen: Landmarks, topic: str = "/landmarks") -> None:
        """Append pfcli.Landmarks, to a tenth of a millimetre."""
        names = ("range_m", "bearing_rad", "sigma_range_m", "sigma_bearing_rad")
        numbers = np.column_stack([seen.range_m, seen.bearing_rad, seen.sigma]).tolist()
        rows = [
            {"id": i} | {k: round(v, 5) for k, v in zip(names, row, strict=True) if math.isfinite(v)}
            for i, row in zip(seen.ids, numbers, strict=True)
        ]
        self.json(topic, "pfcli.Landmarks", seen.stamp_ns, landmarks=rows)

    def line_points(self, lines: LinePoints, topic: str = "/lines") -> None:
        """Append pfcli.LinePoints, to the millimetre."""
        self.json(topic, "pfcli.LinePoints", lines.stamp_ns, points_m=np.round(lines.points_m, 3).tolist())

    def range_finder(self, stamp_ns: int, range_m: float, limits_m: tuple[float, float], name: str) -> None:
        """Append sensor_msgs/Range to /range/NAME, in frame range_NAME."""
        kind = "sensor_msgs/msg/Range"
        made = typestore().types[kind](header(stamp_ns, f"range_{name}"), 1, 0.1, *limits_m, range_m, 0.0)
        self.message(f"/range/{name}", kind, stamp_ns, made)

    def pose(self, stamp_ns: int, pose: Sequence[float], topic: str = "/ground_truth", frame: str = "map") -> None:
        """Append geometry_msgs/PoseStamped of a planar pose (x, y, yaw)."""
        body = _header(stamp_ns, frame)
        body += bytes(-len(body) % 8)
        numbers = struct.pack("<7d", pose[0], pose[1], 0, 0, 0, math.sin(pose[2] / 2), math.cos(pose[2] / 2))
        self.raw(topic, "geometry_msgs/msg/PoseStamped", stamp_ns, _HEAD + body + numbers)

    def source_stamp(self, stamp_ns: int, text: str, topic: str = "/source_stamp") -> None:
        """Append the stamp text of the log that the scan with this stamp came from."""
        self.raw(topic, "std_msgs/msg/String", stamp_ns, _HEAD + _string(text, 0))

    def tf_static(
        self, stamp_ns: int, mounts: Iterable[tuple[str, str, Pose2]], heights_m: Mapping[str, float] | None = None
    ) -> None:
        """Append /tf_static with (parent, child, mount) rows; heights_m: child -> its height (0)."""
        self.tf(stamp_ns, mounts, "/tf_static", heights_m)

    def tf(
        self,
        stamp_ns: int,
        mounts: Iterable[tuple[str, str, Pose2]],
        topic: str = "/tf",
        heights_m: Mapping[str, float] | None = None,
    ) -> None:
        """Append tf2_msgs/TFMessage with (parent, child, planar pose) rows."""
        height = heights_m or {}
        types = typestore().types
        stamped = [
            types["geometry_msgs/msg/TransformStamped"](
                header(stamp_ns, parent),
                child,
                types["geometry_msgs/msg/Transform"](
                    types["geometry_msgs/msg/Vector3"](float(p.x_m), float(p.y_m), height.get(child, 0.0)),
                    quaternion(p.yaw_rad),
                ),
            )
            for parent, child, p in mounts
        ]
        self.message(topic, "tf2_msgs/msg/TFMessage", stamp_ns, types["tf2_msgs/msg/TFMessage"](stamped))


def header(stamp_ns: int, frame: str) -> Any:
    """std_msgs/Header object of rosbags' type system."""
    types = typestore().types
    stamp = types["builtin_interfaces/msg/Time"](stamp_ns // _SECOND, stamp_ns % _SECOND)
    return types["std_msgs/msg/Header"](stamp, frame)


def quaternion(yaw_rad: float) -> Any:
    """geometry_msgs/Quaternion object of a heading."""
    return typestore().types["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2))


def _header(stamp_ns: int, frame: str) -> bytes:
    return struct.pack("<iI", stamp_ns // _SECOND, stamp_ns % _SECOND) + _string(frame, 8)


def _string(text: str, at: int) -> bytes:
    """CDR string that begins at byte `at` of the message (after padding to 4)."""
    data = text.encode() + b"\x00"
    return bytes(-at % 4) + struct.pack("<I", len(data)) + data
