"""Reading and writing logs: every message, odd files, damaged files."""

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from fuzz.corpus import MESSAGES, ros_message
from pfcli.errors import LogError, UsageError
from pfcli.events import Odometry, Pose2, Scan
from pfcli.formats.log_writer import LogWriter
from pfcli.formats.message_writer import header
from pfcli.formats.messages import SECOND
from pfcli.formats.roles import ROLES
from pfcli.formats.schemas import json_schema, ros2msg, ros_types, typestore
from pfcli.replay.log import Log
from pfcli.replay.settings import Image, Settings
from tests.formats.odd_logs import ODD, ODOMETRY, T0, numbers, odometry, records, write

CASES = [(role, schema) for role, types in ROLES.items() for schema in types]


@pytest.mark.parametrize(("role", "schema"), CASES)
def test_one_message_of_each_type_goes_through_write_and_read(role: str, schema: str, tmp_path: Path) -> None:
    path, topic = tmp_path / "x.mcap", "/source_stamp" if role == "source_stamp" else f"/the_{role}"
    with LogWriter(path) as log:
        if schema.startswith("pfcli."):
            log.json(topic, schema, T0, **MESSAGES[schema])
        else:
            log.message(topic, schema, T0, ros_message(schema))
    reading = Settings(topics={role: topic}, image=Image(0.286, (0.0, 0.0)))
    (event,) = Log(path, reading).events([role])
    assert type(event) is ROLES[role][schema]
    assert event.stamp_ns == T0


@pytest.mark.parametrize("name", sorted(MESSAGES))
def test_json_schemas_describe_what_is_read(name: str) -> None:
    schema = json.loads(json_schema(name))
    assert set(schema["required"]) <= {"stamp_ns", *MESSAGES[name]}
    assert set(MESSAGES[name]) <= set(schema["properties"])


def test_every_ros_definition_parses_and_names_itself() -> None:
    for name in ros_types():
        assert name in typestore().types
        assert ros2msg(name).strip()


# --- odd but valid files -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", sorted(ODD))
def test_odd_but_valid_files_give_the_same_events(kind: str, tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", list(range(300)), **ODD[kind])
    log = Log(tmp_path / "x.mcap")
    assert numbers(log) == list(range(300))
    assert not log.dropped


def _edited(data: bytes, change: Callable[[int, bytes], list[bytes]]) -> bytes:
    """A file with other records at the top level, without the summary, whose offsets would be wrong."""
    out = [data[:8]]
    for opcode, start, end in records(data):
        if opcode == 0x0F:
            break
        out += change(opcode, data[start:end])
    end_of_data, footer = b"\x0f" + struct.pack("<QI", 4, 0), b"\x02" + struct.pack("<QQQI", 20, 0, 0, 0)
    return b"".join([*out, end_of_data, footer, data[:8]])


def _padded(record: bytes) -> bytes:
    return record[:1] + struct.pack("<Q", len(record) - 9 + 7) + record[9:] + bytes(7)


EDITS: dict[str, Callable[[int, bytes], list[bytes]]] = {
    "padded records": lambda op, r: [_padded(r) if op != 0x05 else r],
    "private records": lambda op, r: [b"\x99" + struct.pack("<Q", 40) + bytes(range(40)), r],
    "empty chunks": lambda op, r: [_EMPTY_CHUNK, r],
    "no message index": lambda op, r: [] if op == 0x07 else [r],
}
_EMPTY_CHUNK = b"\x06" + struct.pack("<QQQQIIQ", 40, 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize("kind", ["zstd", "none", "unchunked"])
@pytest.mark.parametrize("edit", sorted(EDITS))
def test_odd_records_change_no_event(edit: str, kind: str, tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", list(range(100)), **ODD[kind])
    (tmp_path / "y.mcap").write_bytes(_edited((tmp_path / "x.mcap").read_bytes(), EDITS[edit]))
    log = Log(tmp_path / "y.mcap")
    assert numbers(log) == list(range(100))
    assert not log.dropped


@pytest.mark.parametrize(
    "schema",
    [("", "", b""), (ODOMETRY, "ros2idl", b"module nav_msgs { };"), (ODOMETRY, "", b""), (ODOMETRY, "ros2msg", b"x")],
)
def test_schemas_that_say_nothing_fall_back_to_the_type_by_its_name(
    schema: tuple[str, str, bytes], tmp_path: Path
) -> None:
    write(tmp_path / "x.mcap", list(range(20)), schema)
    assert numbers(tmp_path / "x.mcap", topics={"odometry": "/odom"}) == list(range(20))


def test_several_versions_of_a_schema_on_one_topic(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        for k in range(20):
            if k % 5 == 0:
                schema = writer.register_schema(ODOMETRY, "ros2msg", f"# version {k}".encode())
                channel = writer.register_channel("/odom", "cdr", schema)
            writer.add_message(channel, T0 + k, odometry(k), T0 + k, k)
        writer.finish()
    assert numbers(path) == list(range(20))


def test_an_encoding_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    with open(tmp_path / "x.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/odom", "cbor", writer.register_schema(ODOMETRY, "ros2msg", b""))
        writer.add_message(channel, T0, odometry(0), T0, 0)
        writer.finish()
    with pytest.raises(UsageError, match="'cbor'"):
        numbers(tmp_path / "x.mcap")


def test_messages_out_of_order_are_sorted_within_the_buffer(tmp_path: Path) -> None:
    order = [*range(0, 50), *range(60, 70), *range(50, 60), *range(70, 100)]
    write(tmp_path / "x.mcap", order, chunk_size=3000)
    assert numbers(tmp_path / "x.mcap") == list(range(100))


def test_what_comes_too_late_is_counted(tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", [*range(5, 100), *range(5)], chunk_size=3000)
    log = Log(tmp_path / "x.mcap")
    assert len(list(log.events(["odometry"]))) == 95
    assert log.dropped.counts["late"] == 5
    write(tmp_path / "y.mcap", [*range(5, 100), *range(5)], use_chunking=False)  # the same, whatever the chunks
    assert len(numbers(tmp_path / "y.mcap")) == 95
    assert "time goes back" in log.dropped.notes[0]


@pytest.mark.parametrize("kind", ["zstd", "lz4", "none", "unchunked"])
@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 0.97])
def test_a_cut_log_gives_everything_before_the_cut(kind: str, share: float, tmp_path: Path) -> None:
    write(tmp_path / "whole.mcap", list(range(300)), **ODD[kind])
    data = (tmp_path / "whole.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(share * len(data))])
    log = Log(cut)
    xs = numbers(log)
    assert xs == list(range(len(xs)))
    assert log.dropped.counts["damaged place"] >= 1 or len(xs) == 300
    if kind in ("none", "unchunked"):
        assert len(xs) >= int(0.9 * share * 300) - 3
    elif share >= 0.5:  # compressed: whole chunks before the cut, and what their decompressor gives of the last
        assert len(xs) >= 50


def test_a_damaged_chunk_costs_only_itself(tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", list(range(300)), compression=CompressionType.ZSTD, chunk_size=20_000)
    data = bytearray((tmp_path / "x.mcap").read_bytes())
    starts = [k for k in range(len(data) - 4) if data[k : k + 4] == b"\x28\xb5\x2f\xfd"]
    data[starts[2] + 6 : starts[2] + 30] = bytes(24)
    (tmp_path / "x.mcap").write_bytes(data)
    log = Log(tmp_path / "x.mcap")
    xs = numbers(log)
    assert 200 < len(xs) < 300
    assert xs[0] == 0
    assert xs[-1] == 299
    assert log.dropped.counts["damaged place"] >= 1


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"hello, this is text", "not an MCAP file"),
        (b"\x89MCAP0\r\n", "no such topic|holds no|has none"),
    ],
)
def test_what_is_no_log_is_refused_in_one_line(content: bytes, says: str, tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises((LogError, UsageError), match=says):
        list(Log(path, Settings(topics={"odometry": "/odom"})).events(["odometry"]))
    with pytest.raises((LogError, UsageError), match=says):  # a folder is the recording in it
        list(Log(tmp_path, Settings(topics={"odometry": "/odom"})).events(["odometry"]))


def test_the_clock_and_the_window_can_be_chosen(tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", list(range(100)))
    assert numbers(tmp_path / "x.mcap", start_s=2.0, end_s=3.0) == list(range(20, 31))
    assert numbers(tmp_path / "x.mcap", clock="log") == list(range(100))


# --- extrinsics and topics -----------------------------------------------------------------------------------


def _scan_log(path: Path, frame: str = "laser", tf: bool = True, topics: tuple[str, ...] = ("/scan",)) -> None:
    with LogWriter(path) as log:
        if tf:
            log.tf_static(T0, [("base_link", "deck", Pose2(0.2, 0.0, 0.1)), ("deck", "laser", Pose2(0.1, 0.0, 0.0))])
        for topic in topics:
            log.scan(Scan(T0, np.ones(3, np.float32), 0.0, 0.1, 0.0, 9.0, Pose2()), topic, frame)
        log.odometry(Odometry(T0, 0.0, 0.0, 0.0))


def test_mounts_come_through_a_chain_of_transforms(tmp_path: Path) -> None:
    _scan_log(tmp_path / "x.mcap")
    (scan,) = Log(tmp_path / "x.mcap").events(["scan"])
    assert scan.mount == pytest.approx((0.2 + 0.1 * np.cos(0.1), 0.1 * np.sin(0.1), 0.1))  # type: ignore[union-attr]


def test_an_unknown_frame_names_the_flag(tmp_path: Path) -> None:
    _scan_log(tmp_path / "x.mcap", tf=False)
    with pytest.raises(LogError, match="--extrinsic base_link:laser="):
        list(Log(tmp_path / "x.mcap").events(["scan"]))
    settings = Settings(extrinsics=["base_link:laser=0.3,0,1.5"])
    (scan,) = Log(tmp_path / "x.mcap", settings).events(["scan"])
    assert scan.mount == pytest.approx((0.3, 0, 1.5))  # type: ignore[union-attr]


def test_two_scan_topics_need_a_choice(tmp_path: Path) -> None:
    _scan_log(tmp_path / "x.mcap", topics=("/front", "/rear"))
    with pytest.raises(UsageError, match="--topic scan=TOPIC"):
        list(Log(tmp_path / "x.mcap").events(["scan"]))
    (scan,) = Log(tmp_path / "x.mcap", Settings(topics={"scan": "/rear"})).events(["scan"])
    assert isinstance(scan, Scan)


def test_odometry_can_come_from_tf(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "x.mcap") as log:
        log.tf(T0, [("odom", "base_link", Pose2(1.0, 2.0, 0.3)), ("map", "odom", Pose2(9.0, 9.0, 0.0))])
    (event,) = Log(tmp_path / "x.mcap", Settings(topics={"odometry": "/tf:odom.base_link"})).events(["odometry"])
    assert event == pytest.approx(Odometry(T0, 1.0, 2.0, 0.3), nan_ok=True)


def test_memory_is_bounded_by_the_reorder_horizon(tmp_path: Path) -> None:
    """Buffers of released messages are dropped while the log is read."""
    from pfcli.dropped import Dropped
    from pfcli.formats.mcap_file import McapFile
    from pfcli.replay.reorder import Reorder, Waiting

    write(tmp_path / "x.mcap", list(range(3000)), chunk_size=5000)
    log = Log(tmp_path / "x.mcap")
    waiting = Waiting(2 * SECOND, 1 << 30, "header", {})
    order = Reorder(log.path, log._sources("odometry"), waiting, (None, None), Dropped())
    most = 0
    for _ in order.messages(McapFile(log.path).batches()):
        most = max(most, len(order._buffers))
    assert most <= 12


def test_rosbags_and_the_fixed_offset_decoders_agree(tmp_path: Path) -> None:
    from pfcli.formats.messages import decoder

    ranges = np.linspace(0.5, 3, 17).astype(np.float32)
    with LogWriter(tmp_path / "x.mcap") as log:
        log.scan(Scan(T0, ranges, -1.0, 0.01, 0.1, 8.0, Pose2()), frame="base_link")
        log.odometry(Odometry(T0, 1.25, -2.5, 0.75, 0.5, 0.0, 0.1))
    for role, schema in (("scan", "sensor_msgs/msg/LaserScan"), ("odometry", "nav_msgs/msg/Odometry")):
        for batch in Log(tmp_path / "x.mcap")._file.batches():
            for k in range(batch.offset.size):
                payload = bytes(batch.data[batch.offset[k] : batch.offset[k] + batch.length[k]])
                try:
                    oracle = typestore().deserialize_cdr(payload, schema)
                except Exception:
                    continue
                if role == "scan" and len(oracle.ranges) == 17:
                    event, frame = decoder(role, schema)(payload, 0, len(payload), T0)
                    assert frame == oracle.header.frame_id
                    assert (event.ranges_m == oracle.ranges).all()  # type: ignore[union-attr]
                    assert event.range_max_m == oracle.range_max  # type: ignore[union-attr]
                elif role == "odometry" and oracle.child_frame_id == "base_link":
                    event, _ = decoder(role, schema)(payload, 0, len(payload), T0)
                    assert event[1:4] == pytest.approx((1.25, -2.5, 0.75))
                    assert oracle.pose.pose.position.x == event.x_m  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("kind", "ids"),
    [
        ("vision_msgs/msg/Detection3DArray", ("post",)),
        ("soccer_vision_3d_msgs/msg/GoalpostArray", ("post",)),
        ("soccer_vision_3d_msgs/msg/MarkingArray", ("tee", "circle")),
    ],
)
def test_landmarks_of_ros_messages_are_named_by_what_they_are(kind: str, ids: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    message = ros_message(kind)
    message.header = header(T0, "base_link")
    if kind.endswith("Detection3DArray"):
        message.detections[0].id = "17"
        message.detections[0].results[0].hypothesis.class_id = "post"
    if kind.endswith("MarkingArray"):
        message.intersections[0].num_rays = 3
    with LogWriter(path) as log:
        log.message("/seen", kind, T0, message)
    (event,) = Log(path).events(["landmarks"])
    assert event.ids == ids  # type: ignore[union-attr]
    assert np.allclose(event.range_m, math.hypot(1.5, 1.5))  # type: ignore[union-attr]


def test_vision_in_a_frame_that_is_not_upright_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        types = typestore().types
        half = types["geometry_msgs/msg/Quaternion"](-0.5, 0.5, -0.5, 0.5)
        at = types["geometry_msgs/msg/Transform"](types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.5), half)
        stamped = types["geometry_msgs/msg/TransformStamped"](header(T0, "base_link"), "optical", at)
        log.message("/tf_static", "tf2_msgs/msg/TFMessage", T0, types["tf2_msgs/msg/TFMessage"]([stamped]))
        log.json("/lines", "pfcli.LinePoints", T0, points_m=[[1.0, 2.0]], frame_id="optical")
    with pytest.raises(UsageError, match=r"optical.*upright"):
        list(Log(path).events(["lines"]))


def test_a_compass_is_turned_by_its_mount(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        log.tf_static(T0, [("base_link", "mag", Pose2(0.0, 0.0, 0.5))])
        types = typestore().types
        vector = types["geometry_msgs/msg/Vector3"](0.0, 2e-5, 0.0)
        kind = "sensor_msgs/msg/MagneticField"
        log.message("/mag", kind, T0, types[kind](header(T0, "mag"), vector, np.zeros(9)))
    (event,) = Log(path).events(["compass"])
    # north is on the sensor's left: the sensor looks east, the robot 0.5 rad clockwise of that
    assert event.yaw_rad == pytest.approx(-0.5)  # type: ignore[union-attr]
