"""One short drive in every container, for the tests of readers: odometry, scans and a mount."""

import shutil
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pfcli.events import Odometry, Pose2, Scan
from pfcli.formats import ros1_bag as ros1_bag_format
from pfcli.formats.log_writer import LogWriter
from tests.formats.odd_logs import T0

S = 1_000_000_000
HUMBLE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = {"/odom": "nav_msgs/msg/Odometry", "/scan": "sensor_msgs/msg/LaserScan", "/tf_static": "tf2_msgs/msg/TFMessage"}


def plain(path: Path, count: int = 40) -> Path:
    """The drive as MCAP: 0.25 m and 0.25 s a step along a room of 12 x 6 m."""
    angles = np.radians(np.arange(-90, 91, 2))
    with LogWriter(path) as out:
        out.tf_static(T0, [("base_link", "laser", Pose2(0.1, 0.0, 0.0))])
        for k in range(count):
            t, x = T0 + k * S // 4, 0.25 * k
            out.odometry(Odometry(t, x, 0.0, 0.0, 1.0, 0.0, 0.0))
            with np.errstate(divide="ignore"):
                ahead = (12.0 - x - 0.1) / np.maximum(np.cos(angles), 1e-9)
                aside = 3.0 / np.abs(np.sin(angles))
            ranges = np.minimum(np.minimum(ahead, aside), 30.0).astype(np.float32)
            out.scan(Scan(t, ranges, float(angles[0]), float(np.radians(2)), 0.1, 30.0, Pose2()))
    return path


def messages(path: Path) -> Iterator[tuple[str, str, int, bytes]]:
    """Topic, type, time and payload of an MCAP log."""
    with open(path, "rb") as file:
        for kind, channel, message in make_reader(file).iter_messages():
            assert kind is not None
            yield channel.topic, kind.name, message.log_time, message.data


def mcap(path: Path, source: Path, names: Any = lambda n: n, texts: Any = None, payloads: Any = lambda p: p) -> Path:
    """The messages under other type names, with other definitions, with other payloads."""
    with open(path, "wb") as file:
        writer, ids = Writer(file), dict[str, int]()
        writer.start(profile="ros2")
        for topic, name, stamp, payload in messages(source):
            if topic not in ids:
                text = HUMBLE.generate_msgdef(name, ros_version=2)[0] if texts is None else texts(name)
                ids[topic] = writer.register_channel(
                    topic, "cdr", writer.register_schema(names(name), "ros2msg", text.encode())
                )
            writer.add_message(ids[topic], stamp, payloads(payload), stamp)
        writer.finish()
    return path


def rosbag2(folder: Path, source: Path, storage: str = "SQLITE3", compression: str = "") -> Path:
    """The messages as rosbags writes a rosbag2 folder."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as Bag

    shutil.rmtree(folder, ignore_errors=True)
    bag = Bag(folder, version=8, storage_plugin=StoragePlugin[storage])
    if compression:
        bag.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with bag:
        made = dict[str, Any]()
        for topic, name, stamp, payload in messages(source):
            if topic not in made:
                made[topic] = bag.add_connection(topic, name, typestore=HUMBLE)
            bag.write(made[topic], stamp, payload)
    return folder


def ros1_store() -> Any:
    """ROS 1 types with both names of transforms."""
    store = get_typestore(Stores.ROS1_NOETIC)
    for name in ("tf/msg/tfMessage", "tf2_msgs/msg/TFMessage"):
        if name not in store.types:
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", name))
    return store


def ros1_payload(name: str, payload: bytes) -> bytes:
    """The ROS 1 serialisation of a CDR message."""
    return bytes(HUMBLE.cdr_to_ros1(payload, name))


def ros1_bag(
    path: Path,
    source: Path,
    transforms: str = "tf2_msgs/msg/TFMessage",
    compression: str = "",
    by_topic: bool = False,
    chunk: int = 1 << 20,
) -> Path:
    """The messages as a ROS 1 bag."""
    from rosbags.rosbag1 import Writer as Bag

    path.unlink(missing_ok=True)
    store, bag = ros1_store(), Bag(path)
    bag.chunk_threshold = chunk
    if compression:
        bag.set_compression(Bag.CompressionFormat[compression])
    with bag:
        made = dict[str, Any]()
        for topic, name, stamp, payload in (
            sorted(messages(source), key=lambda m: m[0]) if by_topic else messages(source)
        ):
            shown = transforms if name.endswith("TFMessage") else name
            if topic not in made:
                made[topic] = bag.add_connection(topic, shown, typestore=store)
            bag.write(made[topic], stamp, ros1_payload(name, payload))
    return path


def ros1_mcap(path: Path, source: Path) -> Path:
    """ROS 1 messages in an MCAP file."""
    store = ros1_store()
    with open(path, "wb") as file:
        writer, ids = Writer(file), dict[str, int]()
        writer.start(profile="ros1")
        for topic, name, stamp, payload in messages(source):
            if topic not in ids:
                text = store.generate_msgdef(name, ros_version=1)[0]
                kind = writer.register_schema(name.replace("/msg/", "/"), "ros1msg", text.encode())
                ids[topic] = writer.register_channel(topic, "ros1", kind)
            writer.add_message(ids[topic], stamp, ros1_payload(name, payload), stamp)
        writer.finish()
    return path


def with_wrong_index(data: bytes) -> bytes:
    """A ROS 1 bag whose index records claim eight bytes too many, as old recorders wrote them."""
    out = bytearray(data)
    for _, fields, begin, end in ros1_bag_format._records(memoryview(data), len(ros1_bag_format.MAGIC)):
        if fields[b"op"] == b"\x04":
            struct.pack_into("<I", out, begin - 4, end - begin + 8)
    return bytes(out)
