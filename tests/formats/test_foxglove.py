"""Foxglove's schemas say the same as the ROS messages of the same drive."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory, timestamp_pb2
from mcap.writer import Writer

from pfcli.events import Event, Odometry, Scan, Truth
from pfcli.formats import foxglove_protobuf
from pfcli.replay.log import Log
from pfcli.replay.settings import Settings
from tests.formats.containers import plain
from tests.formats.odd_logs import T0


def _descriptors(shift: int) -> bytes:
    """A FileDescriptorSet of the schemas whose field numbers are `shift` larger than usual: only the file tells."""
    kind = foxglove_protobuf._own("foxglove.LaserScan")
    file = descriptor_pb2.FileDescriptorProto()
    kind.DESCRIPTOR.file.CopyToProto(file)
    for message in file.message_type:
        for field in message.field:
            field.number += shift
    stamp = descriptor_pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
    return descriptor_pb2.FileDescriptorSet(file=[file, stamp]).SerializeToString()


def _class(name: str, shift: int) -> Any:
    if not shift:
        return foxglove_protobuf._own(name)
    pool = descriptor_pool.DescriptorPool()
    for file in reversed(descriptor_pb2.FileDescriptorSet.FromString(_descriptors(shift)).file):
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


class _Log:
    """Writes messages given as dictionaries."""

    def __init__(self, path: Path, encoding: str, shift: int = 0) -> None:
        self._file, self._encoding, self._shift = open(path, "wb"), encoding, shift
        self._writer, self._channels = Writer(self._file), dict[str, int]()
        self._schema = b"\x0a\x00" if not shift else _descriptors(shift)
        self._writer.start()

    def put(self, topic: str, name: str, stamp_ns: int, **values: Any) -> None:
        if topic not in self._channels:
            kind = ("protobuf", self._schema) if self._encoding == "protobuf" else ("jsonschema", b"{}")
            schema = self._writer.register_schema(name, *kind)
            self._channels[topic] = self._writer.register_channel(topic, self._encoding, schema)
        self._writer.add_message(self._channels[topic], stamp_ns, self._payload(name, stamp_ns, values), stamp_ns)

    def _payload(self, name: str, stamp_ns: int, values: dict[str, Any]) -> bytes:
        if self._encoding == "json":
            return json.dumps(_stamped(values, {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9})).encode()
        message = _class(name, self._shift)()
        json_format.ParseDict(_stamped(values, f"{np.datetime64(stamp_ns, 'ns')}Z"), message)
        return bytes(message.SerializeToString())

    def close(self) -> None:
        self._writer.finish()
        self._file.close()


def _stamped(values: dict[str, Any], stamp: Any) -> dict[str, Any]:
    if "transforms" in values:
        return {"transforms": [{**t, "timestamp": stamp} for t in values["transforms"]]}
    return {"timestamp": stamp, **values}


def _turned(yaw_rad: float) -> dict[str, float]:
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw_rad / 2), "w": math.cos(yaw_rad / 2)}


def _pose(e: Any) -> dict[str, Any]:
    return {"position": {"x": e.x_m, "y": e.y_m, "z": 0.0}, "orientation": _turned(e.yaw_rad)}


MOUNT = {"parent_frame_id": "base_link", "child_frame_id": "laser", "translation": {"x": 0.1, "y": 0, "z": 0}}


@pytest.mark.parametrize(("encoding", "shift"), [("json", 0), ("protobuf", 0), ("protobuf", 20)])
@pytest.mark.parametrize("transforms", ["foxglove.FrameTransform", "foxglove.FrameTransforms"])
def test_a_drive_in_them_gives_the_same_events(encoding: str, shift: int, transforms: str, tmp_path: Path) -> None:
    expected = list(Log(plain(tmp_path / "plain.mcap")).events(["odometry", "scan"]))
    log = _Log(tmp_path / "x.mcap", encoding, shift)
    mount = {**MOUNT, "rotation": _turned(0.0)}
    for e in expected:
        if isinstance(e, Odometry):
            log.put("/tf", transforms, e.stamp_ns, **({"transforms": [mount]} if transforms.endswith("s") else mount))
            log.put("/odom", "foxglove.PoseInFrame", e.stamp_ns, frame_id="odom", pose=_pose(e))
            log.put("/ground_truth", "foxglove.PosesInFrame", e.stamp_ns, frame_id="map", poses=[_pose(e)])
        elif isinstance(e, Scan):
            end = e.angle_min_rad + (e.ranges_m.size - 1) * e.angle_increment_rad
            ranges = e.ranges_m.astype(float).tolist()
            angles = {"start_angle": e.angle_min_rad, "end_angle": end}
            log.put("/scan", "foxglove.LaserScan", e.stamp_ns, frame_id="laser", ranges=ranges, **angles)
    log.close()
    opened = Log(tmp_path / "x.mcap")
    found: list[Event] = list(opened.events(["odometry", "scan", "truth"]))
    assert not opened.dropped, opened.dropped.notes
    assert sum(isinstance(e, Truth) for e in found) == 40
    for one, other in zip((e for e in found if not isinstance(e, Truth)), expected, strict=True):
        assert one.stamp_ns == other.stamp_ns
        if isinstance(one, Scan):
            assert isinstance(other, Scan)
            np.testing.assert_array_equal(one.ranges_m, other.ranges_m)
            assert one.mount == pytest.approx(other.mount)
            assert one.angle_increment_rad == pytest.approx(other.angle_increment_rad, abs=1e-7)
        elif isinstance(one, Odometry):
            assert one[1:4] == pytest.approx(other[1:4], abs=1e-12)


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_what_cannot_be_said_otherwise_is_named(encoding: str, tmp_path: Path) -> None:
    log = _Log(tmp_path / "x.mcap", encoding)
    still = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": _turned(0.0)}
    shifted = {"position": {"x": 1, "y": 0, "z": 0}, "orientation": _turned(0.0)}
    log.put("/scan", "foxglove.LaserScan", T0, frame_id="base_link", pose=shifted, ranges=[1.0, 2.0])
    log.put("/odom", "foxglove.PosesInFrame", T0, frame_id="odom", poses=[still, still])
    log.close()
    opened = Log(tmp_path / "x.mcap", Settings())
    assert not list(opened.events(["odometry", "scan"]))
    told = " ".join(opened.dropped.notes)
    assert "'/scan'" in told
    assert "field 'pose' shifts" in told
    assert "holds 2 poses; one is needed" in told


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_clouds_and_fixes_become_ros_messages(encoding: str, tmp_path: Path) -> None:
    import base64

    from pfcli.formats.canonical import Canonical
    from pfcli.formats.recording import Recording
    from pfcli.formats.schemas import typestore

    log = _Log(tmp_path / "x.mcap", encoding)
    points = np.array([[1, 2, 0.5], [3, 4, 0.5]], np.float32)
    fields = [{"name": n, "offset": 4 * k, "type": 7} for k, n in enumerate("xyz")]
    data = base64.b64encode(points.tobytes()).decode()
    log.put("/points", "foxglove.PointCloud", T0, frame_id="lidar", point_stride=12, fields=fields, data=data)
    log.put("/fix", "foxglove.LocationFix", T0, frame_id="gps", latitude=48.1, longitude=11.5, altitude=520.0)
    log.close()
    reader = Canonical(Recording([tmp_path / "x.mcap"]), 256)
    seen = {}
    for batch in reader.batches():
        for k, ident in enumerate(batch.channel.tolist()):
            name = reader.channels[ident].schema_name
            payload = batch.data[int(batch.offset[k]) : int(batch.offset[k] + batch.length[k])]
            seen[name] = typestore().deserialize_cdr(payload, name)
    cloud, fix = seen["sensor_msgs/msg/PointCloud2"], seen["sensor_msgs/msg/NavSatFix"]
    assert (cloud.width, cloud.point_step, [f.name for f in cloud.fields]) == (2, 12, ["x", "y", "z"])
    np.testing.assert_array_equal(np.frombuffer(cloud.data, np.float32).reshape(-1, 3), points)
    assert (fix.latitude, fix.longitude, fix.header.frame_id) == (48.1, 11.5, "gps")
