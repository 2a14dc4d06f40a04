"""The same drive in every container gives the same events; what nobody knows is refused with what can be read."""

import bz2
import gzip
import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader

from pfcli.errors import LogError
from pfcli.events import Event, Odometry, Scan
from pfcli.formats.log_writer import LogWriter
from pfcli.replay.log import Log
from pfcli.replay.settings import Settings
from tests.conftest import needs
from tests.formats import containers
from tests.formats.containers import S, mcap, plain, ros1_bag, ros1_mcap, rosbag2
from tests.formats.odd_logs import ODOMETRY, T0, numbers, odometry, write

Make = Callable[[Path, Path], Path]


def _first(folder: Path, pattern: str) -> Path:
    return next(folder.glob(pattern))


def _lone_db3(folder: Path, source: Path) -> Path:
    bag = rosbag2(folder / "bag", source)
    (bag / "metadata.yaml").unlink()
    return _first(bag, "*.db3")


def _packed(path: Path, source: Path, pack: Callable[[bytes], bytes]) -> Path:
    path.write_bytes(pack(source.read_bytes()))
    return path


def _old_index(folder: Path, source: Path) -> Path:
    path = ros1_bag(folder / "x.bag", source)
    path.write_bytes(containers.with_wrong_index(path.read_bytes()))
    return path


MAKE: dict[str, Make] = {
    "rosbag2 folder": lambda d, s: rosbag2(d / "bag", s),
    "rosbag2 folder of MCAP": lambda d, s: rosbag2(d / "bag", s, "MCAP"),
    "lone db3": _lone_db3,
    "files compressed": lambda d, s: rosbag2(d / "bag", s, compression="FILE"),
    "lone db3.zstd": lambda d, s: _first(rosbag2(d / "bag", s, compression="FILE"), "*.zstd"),
    "messages compressed in SQLite": lambda d, s: rosbag2(d / "bag", s, compression="MESSAGE"),
    "messages compressed in MCAP": lambda d, s: _first(rosbag2(d / "bag", s, "MCAP", "MESSAGE"), "*.mcap"),
    "mcap.zstd": lambda d, s: _packed(d / "x.mcap.zstd", s, zstandard.ZstdCompressor().compress),
    "mcap.gz": lambda d, s: _packed(d / "x.mcap.gz", s, gzip.compress),
    "mcap.bz2": lambda d, s: _packed(d / "x.mcap.bz2", s, bz2.compress),
    "ROS 1 bag": lambda d, s: ros1_bag(d / "x.bag", s),
    "ROS 1 bag, bz2": lambda d, s: ros1_bag(d / "x.bag", s, compression="BZ2"),
    "ROS 1 bag, lz4": lambda d, s: ros1_bag(d / "x.bag", s, compression="LZ4"),
    "ROS 1 bag, tf/tfMessage": lambda d, s: ros1_bag(d / "x.bag", s, "tf/msg/tfMessage"),
    "ROS 1 bag, old index": _old_index,
    "ROS 1 in MCAP": lambda d, s: ros1_mcap(d / "x.mcap", s),
    "short type names": lambda d, s: mcap(d / "x.mcap", s, lambda n: n.replace("/msg/", "/")),
    "type names of DDS": lambda d, s: mcap(
        d / "x.mcap", s, lambda n: n.replace("/msg/", "::msg::dds_::") + "_", lambda _: ""
    ),
}


def _events(path: Path) -> tuple[list[Event], Log]:
    log = Log(path)
    return list(log.events(["odometry", "scan"])), log


@pytest.mark.parametrize("kind", sorted(MAKE))
def test_every_container_gives_the_same_events(kind: str, tmp_path: Path) -> None:
    source = plain(tmp_path / "source.mcap")
    expected, _ = _events(source)
    (tmp_path / "in").mkdir()
    found, log = _events(MAKE[kind](tmp_path / "in", source))
    assert not log.dropped, log.dropped.notes
    assert len(found) == len(expected) == 80
    for one, other in zip(found, expected, strict=True):
        if isinstance(one, Scan):
            assert isinstance(other, Scan)
            np.testing.assert_array_equal(one.ranges_m, other.ranges_m)
            assert one.mount == other.mount
            assert one.stamp_ns == other.stamp_ns
        else:
            assert one == other


def test_fields_of_other_definitions_go_by_name(tmp_path: Path) -> None:
    """Range of newer distributions has one field more; here a scan lacks two, has another, and they stand in another order."""
    source = plain(tmp_path / "source.mcap", 5)
    text = (
        "std_msgs/Header header\nfloat32[] ranges\nfloat64 angle_min\nfloat32 angle_increment\nfloat32 range_min\n"
        "float32 range_max\nuint8[3] colour\n" + "=" * 80 + "\nMSG: std_msgs/Header\n"
        "builtin_interfaces/Time stamp\nstring frame_id\n"
        + "=" * 80
        + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, "sensor_msgs/msg/LaserScan"))

    def payload(data: bytes) -> bytes:
        try:
            old = containers.HUMBLE.deserialize_cdr(data, "sensor_msgs/msg/LaserScan")
            assert old.header.frame_id == "laser"
        except Exception:
            return data
        kinds = store.types
        stamp = kinds["builtin_interfaces/msg/Time"](old.header.stamp.sec, old.header.stamp.nanosec)
        new = kinds["sensor_msgs/msg/LaserScan"](
            kinds["std_msgs/msg/Header"](stamp, "laser"), old.ranges, old.angle_min, old.angle_increment,
            old.range_min, old.range_max, np.zeros(3, np.uint8),
        )  # fmt: skip
        return bytes(store.serialize_cdr(new, "sensor_msgs/msg/LaserScan"))

    def definition(name: str) -> str:
        return text if name.endswith("LaserScan") else containers.HUMBLE.generate_msgdef(name, ros_version=2)[0]

    path = mcap(tmp_path / "x.mcap", source, texts=definition, payloads=payload)
    expected, found = _events(source)[0], _events(path)[0]
    for one, other in zip(found, expected, strict=True):
        if isinstance(one, Scan):
            assert isinstance(other, Scan)
            np.testing.assert_array_equal(one.ranges_m, other.ranges_m)
            assert (one.angle_min_rad, one.range_max_m) == (other.angle_min_rad, other.range_max_m)


def test_a_definition_without_what_matters_is_named(tmp_path: Path) -> None:
    source = plain(tmp_path / "source.mcap", 5)
    text = "float64 x\n"
    path = mcap(tmp_path / "x.mcap", source, texts=lambda _: text, payloads=lambda _: b"\0\1\0\0" + bytes(8))
    log = Log(path)
    assert not list(log.events(["odometry"]))
    assert "topic '/odom': 5 messages cannot be translated" in log.dropped.notes[0]
    assert "'header'" in log.dropped.notes[0]


def test_what_nobody_knows_is_refused_with_what_can_be_read(tmp_path: Path) -> None:
    (tmp_path / "x.xyz").write_bytes(bytes(range(256)))
    (tmp_path / "empty").mkdir()
    for path in (tmp_path / "x.xyz", tmp_path / "empty"):
        with pytest.raises(
            LogError, match=r"nothing else that can be read: .*\.db3.*CARMEN.*LEGO folder.*RobotN_Odometry\.dat"
        ) as info:
            Log(path)
        assert str(path) in str(info.value)
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V1.2\n" + bytes(99))
    with pytest.raises(LogError, match=r"bag of version 1\.2; `rosbag fix`"):
        Log(tmp_path / "old.bag")
    (tmp_path / "x.db3").write_bytes(b"SQLite format 3\0" + bytes(99))
    with pytest.raises(LogError, match="no bag of rosbag2"):
        Log(tmp_path / "x.db3")


@pytest.mark.parametrize("compression", ["", "BZ2", "LZ4"])
def test_a_cut_or_damaged_bag_gives_what_it_holds(compression: str, tmp_path: Path) -> None:
    path = ros1_bag(tmp_path / "x.bag", plain(tmp_path / "source.mcap", 400), compression=compression)
    whole, data = _events(path)[0], path.read_bytes()
    (tmp_path / "cut.bag").write_bytes(data[: len(data) // 2])
    found, log = _events(tmp_path / "cut.bag")
    assert [e.stamp_ns for e in found] == [e.stamp_ns for e in whole[: len(found)]]
    assert log.dropped.counts["damaged place"] == 1


@pytest.mark.parametrize("chunk", [400, 20_000, 1 << 20])
def test_a_bag_is_read_in_the_order_of_its_times(chunk: int, tmp_path: Path) -> None:
    """All odometry was written first, then all scans: only the index, or sorting, brings them together."""
    source = plain(tmp_path / "source.mcap", 100)
    path = ros1_bag(tmp_path / "x.bag", source, by_topic=True, chunk=chunk)
    found, log = _events(path)
    assert not log.dropped, log.dropped.notes
    assert [(type(e), e.stamp_ns) for e in found] == [(type(e), e.stamp_ns) for e in _events(source)[0]]


def test_several_robots_of_one_folder_ask_which(tmp_path: Path) -> None:
    for name in ("Robot1_Measurement.dat", "Robot3_Measurement.dat"):
        (tmp_path / name).write_text("")
    with pytest.raises(LogError, match=r"holds 2 robots of MR\.CLAM; name one of Robot1_Measurement\.dat, Robot3"):
        Log(tmp_path)


def test_any_file_of_a_robot_of_mrclam_is_that_robot(tmp_path: Path) -> None:
    files = {
        "Robot3_Measurement.dat": "1.0 72 2.0 0.5\n",
        "Robot3_Odometry.dat": "0.5 0.1 0.0\n1.5 0.1 0.0\n",
        "Robot3_Groundtruth.dat": "1.0 0 0 0\n",
        "Barcodes.dat": "7 72\n",
        "Landmark_Groundtruth.dat": "7 2.0 1.0 0 0\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    for path in (tmp_path, *(tmp_path / name for name in files if name.startswith("Robot"))):
        assert len(list(Log(path).events(["landmarks", "twist"]))) == 3
    (tmp_path / "Barcodes.dat").unlink()
    with pytest.raises(LogError, match=r"needs Barcodes\.dat beside it"):
        Log(tmp_path)


@pytest.mark.real
def test_small_bags_of_other_people() -> None:
    folder = needs("field/old-index.bag", "field/roslib-header.bag", "field/talker.db3") / "field"
    from pfcli.formats.recording import Recording

    assert Recording([folder / "talker.db3"]).span() == (1585866235112411371, 1585866239643508139, 20)
    old = Recording([folder / "old-index.bag"])
    assert old.span() == (1_000_000_000, 3_000_000_000, 3)
    assert not old.losses
    mounted = Settings(extrinsics=("base_link:laser=0,0,0",))
    scans = [e for e in Log(folder / "roslib-header.bag", mounted).events(["scan"]) if isinstance(e, Scan)]
    assert len(scans) == 40
    assert isinstance(scans[0].ranges_m, np.ndarray)
    assert not [e for e in scans if isinstance(e, Odometry)]


# --- the command line ------------------------------------------------------------------------------------------

Cli = Callable[..., "subprocess.CompletedProcess[str]"]
FEW = ("--particles", "2", "--threads", "1", "-q")


@pytest.mark.parametrize(
    "kind", ["rosbag2 folder", "ROS 1 bag", "messages compressed in MCAP", "ROS 1 in MCAP", "CARMEN"]
)
def test_a_run_of_it_is_that_of_its_conversion(kind: str, pfcli: Cli, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    if kind == "CARMEN":
        path = tmp_path / "in" / "x.clf.bz2"
        path.write_bytes(bz2.compress(_carmen().encode()))
    else:
        path = MAKE[kind](tmp_path / "in", plain(tmp_path / "source.mcap"))
    tracks = []
    for log in (path, tmp_path / "converted.mcap"):
        if log != path:
            done = pfcli("convert", path, log)
            assert done.returncode == 0, done.stderr
        done = pfcli("slam-gdr", log, "--out", tmp_path / "run", "--force", *FEW)
        assert done.returncode == 0, done.stderr
        tracks.append((tmp_path / "run/track.tum").read_bytes())
    assert tracks[0] == tracks[1]
    assert len(tracks[0].splitlines()) == 40


def _carmen() -> str:
    angles = np.radians(np.arange(-90, 90))
    lines = []
    for k in range(40):
        x = 0.25 * k
        with np.errstate(divide="ignore"):
            ranges = np.minimum(3 / np.abs(np.sin(angles)), (12 - x) / np.maximum(np.cos(angles), 1e-9))
        text = " ".join(f"{r:.2f}" for r in np.minimum(ranges, 81.83))
        lines.append(f"FLASER 180 {text} {x} 0 0 {x} 0 0 {100 + k * 0.25:.6f} host {k}")
    return "\n".join(lines)


def test_convert_leaves_nothing_when_it_fails_and_names_what_it_does_not_read(pfcli: Cli, tmp_path: Path) -> None:
    source, target = plain(tmp_path / "source.mcap", 4), tmp_path / "x.mcap"
    with LogWriter(tmp_path / "none.mcap"):
        pass
    target.write_bytes(b"an older good one")
    done = pfcli("convert", tmp_path / "none.mcap", target, "--force")
    assert done.returncode == 1
    assert "holds no message" in done.stderr
    assert target.read_bytes() == b"an older good one"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["none.mcap", "source.mcap", "x.mcap"]
    odd = mcap(tmp_path / "odd.mcap", source, lambda n: "camera_msgs/msg/Frame" if n.endswith("Odometry") else n)
    done = pfcli("convert", odd, target, "--force")
    assert done.returncode == 0
    assert "camera_msgs/msg/Frame (4)" in done.stdout
    assert [name for _, name, _, _ in containers.messages(target)].count("camera_msgs/msg/Frame") == 4


def test_convert_joins_parts_and_keeps_attachments(pfcli: Cli, tmp_path: Path) -> None:
    from mcap.writer import Writer

    for k in range(2):
        with open(tmp_path / f"bag_{k}.mcap", "wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel("/odom", "cdr", writer.register_schema(ODOMETRY, "ros2msg", b""))
            writer.add_attachment(1, 2, f"notes{k}.txt", "text/plain", b"by hand")
            writer.add_metadata("robot", {"part": str(k)})
            for n in range(5 * k, 5 * k + 5):
                writer.add_message(channel, T0 + n * S // 10, odometry(n), T0 + n * S // 10)
            writer.finish()
    done = pfcli("convert", tmp_path / "bag_1.mcap", tmp_path / "bag_0.mcap", tmp_path / "x.mcap", "--json")
    assert done.returncode == 0, done.stderr
    assert numbers(tmp_path / "x.mcap") == list(range(10))
    with open(tmp_path / "x.mcap", "rb") as file:
        reader = make_reader(file)
        assert [a.name for a in reader.iter_attachments()] == ["notes0.txt", "notes1.txt"]
        assert [m.metadata for m in reader.iter_metadata()] == [{"part": "0"}, {"part": "1"}]


def test_info_of_a_folder(pfcli: Cli, tmp_path: Path) -> None:
    bag = rosbag2(tmp_path / "bag", plain(tmp_path / "source.mcap"))
    found = json.loads(pfcli("info", bag, "--json").stdout)
    assert found["messages"] == 81
    assert found["systems"]["slam-gdr"] == "yes"
    assert found["parts"] == []
    assert "base_link > laser" in found["frames"]


def test_info_of_parts_shows_each(pfcli: Cli, tmp_path: Path) -> None:
    write(tmp_path / "bag_0.mcap", list(range(30)))
    write(tmp_path / "bag_1.mcap", list(range(30, 50)))
    done = pfcli("info", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "50 messages, 4.900 s" in done.stdout
    assert "part bag_1.mcap: 20 messages from 2023-11-14 22:13:23 UTC on, 1.900 s" in done.stdout
