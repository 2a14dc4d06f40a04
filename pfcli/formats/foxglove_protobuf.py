"""Protobuf messages by the descriptor that the file carries; where it says nothing, by Foxglove's own definitions."""

from collections.abc import Callable
from functools import cache
from typing import Any

from pfcli.formats.reader import Channel

_DOUBLE, _FIXED32, _INT32, _INT64, _STRING, _BYTES, _MESSAGE = 1, 7, 5, 3, 9, 12, 11
_STAMP = ".google.protobuf.Timestamp"
_DEFINED: dict[str, list[tuple[str, int, int, str]]] = {
    "Vector3": [("x", 1, _DOUBLE, ""), ("y", 2, _DOUBLE, ""), ("z", 3, _DOUBLE, "")],
    "Quaternion": [("x", 1, _DOUBLE, ""), ("y", 2, _DOUBLE, ""), ("z", 3, _DOUBLE, ""), ("w", 4, _DOUBLE, "")],
    "Pose": [("position", 1, _MESSAGE, "Vector3"), ("orientation", 2, _MESSAGE, "Quaternion")],
    "PackedElementField": [("name", 1, _STRING, ""), ("offset", 2, _FIXED32, ""), ("type", 3, _INT32, "")],
    "LaserScan": [
        ("timestamp", 1, _MESSAGE, _STAMP), ("frame_id", 2, _STRING, ""), ("pose", 3, _MESSAGE, "Pose"),
        ("start_angle", 4, _DOUBLE, ""), ("end_angle", 5, _DOUBLE, ""), ("ranges", 6, _DOUBLE, "*"),
        ("intensities", 7, _DOUBLE, "*"),
    ],
    "PoseInFrame": [("timestamp", 1, _MESSAGE, _STAMP), ("frame_id", 2, _STRING, ""), ("pose", 3, _MESSAGE, "Pose")],
    "PosesInFrame": [("timestamp", 1, _MESSAGE, _STAMP), ("frame_id", 2, _STRING, ""), ("poses", 3, _MESSAGE, "*Pose")],
    "FrameTransform": [
        ("timestamp", 1, _MESSAGE, _STAMP), ("parent_frame_id", 2, _STRING, ""), ("child_frame_id", 3, _STRING, ""),
        ("translation", 4, _MESSAGE, "Vector3"), ("rotation", 5, _MESSAGE, "Quaternion"),
    ],
    "FrameTransforms": [("transforms", 1, _MESSAGE, "*FrameTransform")],
    "PointCloud": [
        ("timestamp", 1, _MESSAGE, _STAMP), ("frame_id", 2, _STRING, ""), ("pose", 3, _MESSAGE, "Pose"),
        ("point_stride", 4, _FIXED32, ""), ("fields", 5, _MESSAGE, "*PackedElementField"), ("data", 6, _BYTES, ""),
    ],
    "LocationFix": [
        ("timestamp", 1, _MESSAGE, _STAMP), ("frame_id", 2, _STRING, ""), ("latitude", 3, _DOUBLE, ""),
        ("longitude", 4, _DOUBLE, ""), ("altitude", 5, _DOUBLE, ""), ("position_covariance", 6, _DOUBLE, "*"),
        ("position_covariance_type", 7, _INT32, ""),
    ],
}  # fmt: skip
"""Message -> fields: name, number, type, name of the message (* in front: repeated)."""


def reader(channel: Channel) -> Callable[[bytes], Any]:
    """What reads payloads of a channel; absent messages read as None."""
    kind = _carried(channel) or _own(channel.schema_name)

    def read(payload: bytes) -> Any:
        return _View(kind.FromString(payload))

    return read


class _View:
    """A protobuf message whose message fields are None where they are not set."""

    def __init__(self, message: Any) -> None:
        self._message = message

    def __getattr__(self, name: str) -> Any:
        field = self._message.DESCRIPTOR.fields_by_name.get(name)
        if field is None:
            return None
        value = getattr(self._message, name)
        if field.type != field.TYPE_MESSAGE:
            return value
        if isinstance(value, type(self._message)) or hasattr(value, "DESCRIPTOR"):
            return _View(value) if self._message.HasField(name) else None
        return [_View(item) for item in value]


def _carried(channel: Channel) -> Any:
    """The class of the messages by the file's descriptor; None where it does not describe them."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    try:
        found = descriptor_pb2.FileDescriptorSet.FromString(channel.schema)
        pool, left = descriptor_pool.DescriptorPool(), list(found.file)
        _with_timestamp(pool, left)
        while left:  # a file is added when those that it imports are there
            ready = [f for f in left if not any(d in {o.name for o in left} for d in f.dependency)]
            for file in ready or left:
                pool.Add(file)
            left = [f for f in left if f not in ready] if ready else []
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel.schema_name))
    except Exception:  # whatever protobuf trips over: then Foxglove's own definitions must do
        return None


def _with_timestamp(pool: Any, files: list[Any]) -> None:
    """Add the usual definition of a time, unless the file has it."""
    from google.protobuf import descriptor_pb2, timestamp_pb2

    if not any(file.name == timestamp_pb2.DESCRIPTOR.name for file in files):
        pool.Add(descriptor_pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb))


@cache
def _own(name: str) -> Any:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

    file = descriptor_pb2.FileDescriptorProto(name="foxglove.proto", package="foxglove", syntax="proto3")
    file.dependency.append(timestamp_pb2.DESCRIPTOR.name)
    for message, fields in _DEFINED.items():
        added = file.message_type.add(name=message)
        for field, number, kind, other in fields:
            label = 3 if other.startswith("*") else 1
            of = other.lstrip("*")
            made = added.field.add(name=field, number=number, type=kind, label=label)
            if of:
                made.type_name = of if of.startswith(".") else f".foxglove.{of}"
    pool = descriptor_pool.DescriptorPool()
    _with_timestamp(pool, [])
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
