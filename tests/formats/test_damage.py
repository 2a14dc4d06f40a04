"""Cut, flipped and hostile files: what is untouched is read, what is not is said, and nothing is believed."""

import bz2
import json
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType

from pfcli.errors import LogError, UsageError
from pfcli.events import Odometry, Pose2, Scan
from pfcli.formats import carmen, map_yaml, mcap_repair
from pfcli.formats.limits import Limits
from pfcli.formats.log_writer import LogWriter
from pfcli.formats.mcap_file import McapFile
from pfcli.formats.roles import ROLES
from pfcli.replay.log import Log
from pfcli.replay.settings import Settings
from tests.formats.odd_logs import ODD, T0, numbers, records, write

N = 2000
READING = Settings(topics={"odometry": "/odom"})
COUNTS = [pytest.param(25, 60), pytest.param(500, 2000, marks=pytest.mark.slow)]
"""Cuts and flips; as many as the promise names when there is time."""


def _read(path: Path, data: bytes) -> tuple[list[int], Log, float]:
    path.write_bytes(data)
    began = time.perf_counter()
    log = Log(path, READING)
    found = numbers(log)
    return found, log, time.perf_counter() - began


def _chunks(path: Path) -> list[tuple[int, int, int]]:
    """Start and end of each chunk, and how many messages are in it."""
    data = path.read_bytes()
    found = []
    for opcode, start, end in records(data):
        if opcode == 0x06:
            found.append([start, end, 0])
        elif opcode == 0x07:
            found[-1][2] += struct.unpack_from("<I", data, start + 11)[0] // 16
    return [(a, b, c) for a, b, c in found]


@pytest.mark.parametrize(("cuts", "flips"), COUNTS)
@pytest.mark.parametrize("kind", ["none", "lz4", "zstd"])
def test_a_cut_costs_no_more_than_the_chunk_that_it_goes_through(
    kind: str, cuts: int, flips: int, tmp_path: Path
) -> None:
    write(tmp_path / "x.mcap", list(range(N)), **ODD[kind])
    data, chunks = (tmp_path / "x.mcap").read_bytes(), _chunks(tmp_path / "x.mcap")
    assert sum(count for _, _, count in chunks) == N
    with pytest.raises(UsageError, match="cut off at byte 509"):
        _read(tmp_path / "y.mcap", data[:509])
    for cut in np.random.default_rng(3).integers(chunks[0][0] + 3000, len(data), cuts).tolist():
        found, log, seconds = _read(tmp_path / "y.mcap", data[:cut])
        whole = sum(count for _, end, count in chunks if end <= cut)
        assert found[:whole] == list(range(whole)), cut
        assert found == list(range(len(found))), cut
        assert log.dropped or len(found) == N, cut
        assert seconds < 5.0


@pytest.mark.parametrize(("cuts", "flips"), COUNTS)
@pytest.mark.parametrize("kind", ["none", "lz4", "zstd"])
def test_a_flipped_bit_costs_no_more_than_its_chunk_and_is_never_silent(
    kind: str, cuts: int, flips: int, tmp_path: Path
) -> None:
    write(tmp_path / "x.mcap", list(range(N)), **ODD[kind])
    data, chunks = (tmp_path / "x.mcap").read_bytes(), _chunks(tmp_path / "x.mcap")
    first = np.cumsum([0, *(count for _, _, count in chunks)])
    rng, codes = np.random.default_rng(7), Counter[bool]()
    for _ in range(flips):
        at, bit = int(rng.integers(8, len(data))), int(rng.integers(8))
        flipped = bytearray(data)
        flipped[at] ^= 1 << bit
        found, log, seconds = _read(tmp_path / "y.mcap", bytes(flipped))
        hit = next((k for k, (start, end, _) in enumerate(chunks) if start <= at < end), None)
        untouched = set(range(N)) - (set(range(first[hit], first[hit + 1])) if hit is not None else set())
        assert untouched <= set(found), (at, bit)
        assert log.dropped or found == list(range(N)), (at, bit)
        assert seconds < 5.0, (at, bit)
        codes[bool(log.dropped)] += 1
    assert codes[True] > flips // 2  # nearly all of a file is its chunks


@pytest.mark.parametrize("cuts", [pytest.param(12), pytest.param(100, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["none", "lz4", "zstd"])
def test_the_end_of_a_cut_log_is_used_and_its_loss_said_in_seconds(kind: str, cuts: int, tmp_path: Path) -> None:
    """Chunks of a minute, longer than the reorder buffer; what a cut one still gives is no leap of time."""
    write(tmp_path / "x.mcap", list(range(N)), **ODD[kind] | {"chunk_size": 500_000})
    data, chunks = (tmp_path / "x.mcap").read_bytes(), _chunks(tmp_path / "x.mcap")
    for cut in np.random.default_rng(11).integers(chunks[0][1], chunks[-1][1], cuts).tolist():
        found, log, _ = _read(tmp_path / "y.mcap", data[:cut])
        assert set(log.dropped.counts) == {"damaged place"}, cut
        assert len(log.dropped.notes) == 1, cut
        inside = next((c for c in chunks if c[0] + 25 <= cut < c[1]), None)
        if inside is None:
            continue
        sent = sum(count for _, end, count in chunks if end <= inside[1])  # messages up to the end of the cut chunk
        lost_s = 0.1 * (sent - len(found))  # by hand: ten messages a second
        says = f"the last {lost_s:.3f} s are lost" if lost_s else "its last messages are there"
        assert says in log.dropped.notes[0], cut


def test_a_log_cut_in_its_only_chunk_gives_what_is_before_the_cut(tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", list(range(100)), compression=CompressionType.NONE)
    data = (tmp_path / "x.mcap").read_bytes()
    found, log, _ = _read(tmp_path / "y.mcap", data[: len(data) // 3])
    assert found == list(range(len(found)))
    assert len(found) > 25
    assert log.dropped


@pytest.mark.parametrize("kind", ["none", "zstd"])
def test_repair_writes_what_can_be_read_and_a_clean_file(kind: str, tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", list(range(N)), **ODD[kind])
    data, chunks = bytearray((tmp_path / "x.mcap").read_bytes()), _chunks(tmp_path / "x.mcap")
    for start, _, _ in chunks[3:6]:
        data[start : start + 60] = bytes(60)
    (tmp_path / "y.mcap").write_bytes(data[: chunks[-2][1] - 40])
    done = mcap_repair.repair(tmp_path / "y.mcap", tmp_path / "z.mcap")
    before = numbers(Log(tmp_path / "y.mcap", READING))
    log = Log(tmp_path / "z.mcap")
    assert numbers(log) == before
    assert not log.dropped
    assert done.messages == len(before) > 0.9 * N
    assert done.losses
    with open(tmp_path / "z.mcap", "rb") as file:  # an independent reader that goes by the index
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(before) == sum(1 for _ in reader.iter_messages())


def test_repair_keeps_every_byte_of_a_whole_file(tmp_path: Path) -> None:
    """Foreign topics, schemaless channels, channel metadata, attachments, times and sequences."""
    from mcap.writer import Writer

    with open(tmp_path / "x.mcap", "wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        image = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"uint8[] data")
        channels = [
            writer.register_channel("/camera", "cdr", image, {"offered_qos_profiles": "- history: 3"}),
            writer.register_channel("/bytes", "x-own", 0),
        ]
        writer.add_attachment(1, 2, "notes.txt", "text/plain", b"by hand")
        writer.add_metadata("robot", {"name": "r2"})
        for k in range(50):
            writer.add_message(channels[k % 2], (1 << 63) + k, bytes([k] * k), k, 7 * k)
        writer.finish()
    done = mcap_repair.repair(tmp_path / "x.mcap", tmp_path / "y.mcap", "lz4")
    assert done == (50, 2, 2, 0, [])

    def content(path: Path) -> list[object]:
        with open(path, "rb") as file:
            reader = make_reader(file)
            rows = list[object]()
            for kind, channel, message in reader.iter_messages():
                rows.append(kind and (kind.name, kind.encoding, kind.data))
                rows += [channel.topic, channel.message_encoding, channel.metadata]
                rows += [message.log_time, message.publish_time, message.sequence, message.data]
            rows += [(a.name, a.media_type, a.log_time, a.create_time, a.data) for a in reader.iter_attachments()]
            return rows + [(m.name, m.metadata) for m in reader.iter_metadata()]

    assert content(tmp_path / "y.mcap") == content(tmp_path / "x.mcap")
    assert McapFile(tmp_path / "y.mcap").profile == "ros2"


def test_repair_says_what_it_cannot_keep(tmp_path: Path) -> None:
    """Metadata of channels, attachments and metadata records that cannot be read; topics without messages are kept."""
    from mcap.writer import Writer

    with open(tmp_path / "x.mcap", "wb") as file:
        writer = Writer(file, use_chunking=False, repeat_channels=False, repeat_schemas=False)
        writer.start()
        used = writer.register_channel("/used", "json", 0, {"key": "value"})
        writer.register_channel("/idle", "json", 0)
        writer.add_message(used, 1, b"{}", 1)
        writer.add_attachment(1, 2, "notes.txt", "text/plain", b"by hand")
        writer.finish()
    data = (tmp_path / "x.mcap").read_bytes().replace(b"value", b"\xff\xfe\xfd\xfc\xfb").replace(b"by hand", b"BY hand")
    (tmp_path / "y.mcap").write_bytes(data)
    done = mcap_repair.repair(tmp_path / "y.mcap", tmp_path / "z.mcap")
    assert (done.messages, done.topics, done.extras) == (1, 1, 1)
    told = " ".join(done.losses)
    assert "metadata of the channel '/used'" in told
    assert "'notes.txt' fails its checksum" in told


# --- hostile files -------------------------------------------------------------------------------------------


def _file(path: Path, *bodies: bytes) -> Path:
    path.write_bytes(b"\x89MCAP0\r\n" + b"".join(bodies))
    return path


def _record(opcode: int, body: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(body) if length is None else length) + body


def _chunk(body: bytes, compression: bytes, size: int) -> bytes:
    head = struct.pack("<QQQII", 0, 0, size, 0, len(compression)) + compression
    return _record(0x06, head + struct.pack("<Q", len(body)) + body)


def _zstd_bomb(mib: int, sized: bool = True) -> bytes:
    import zstandard

    return zstandard.ZstdCompressor(write_content_size=sized).compress(bytes(mib << 20))


def _lz4_bomb(mib: int) -> bytes:
    import lz4.frame

    return bytes(lz4.frame.compress(bytes(mib << 20), store_size=True))


_SELF = struct.pack("<HI", 1, 1) + b"A" + struct.pack("<I", 7) + b"ros2msg" + struct.pack("<I", 3) + b"A a"
HOSTILE: dict[str, Callable[[], bytes]] = {
    "a chunk that claims 100 GiB": lambda: _chunk(b"", b"", 100 << 30),
    "a compressed chunk that claims 100 GiB": lambda: _chunk(_zstd_bomb(1), b"zstd", 100 << 30),
    "a record of 2^63 bytes": lambda: _record(0x05, bytes(22), 1 << 63),
    "a record of 2^64 - 1 bytes": lambda: _record(0x06, bytes(60), (1 << 64) - 1),
    "a zstd bomb": lambda: _chunk(_zstd_bomb(300), b"zstd", 300 << 20),
    "a zstd bomb that claims a byte": lambda: _chunk(_zstd_bomb(300), b"zstd", 1),
    "a zstd bomb without a size": lambda: _chunk(_zstd_bomb(300, sized=False), b"zstd", 1 << 20),
    "an lz4 bomb": lambda: _chunk(_lz4_bomb(300), b"lz4", 300 << 20),
    "an lz4 bomb that claims a byte": lambda: _chunk(_lz4_bomb(300), b"lz4", 1),
    "a compression that nobody knows": lambda: _chunk(bytes(50), b"brotli", 100),
    "a channel of a name of 4 GiB": lambda: _record(0x04, struct.pack("<HHI", 1, 0, 0xFFFFFFFF) + b"x"),
    "a schema that contains itself": lambda: _record(0x03, _SELF),
}

_LOOK = """
import json, sys, time
from pathlib import Path
from pfcli.formats.mcap_file import McapFile
for name in sys.argv[1:]:
    began = time.perf_counter()
    file = McapFile(Path(name))
    messages = sum(len(batch.channel) for batch in file.batches())
    print(json.dumps([messages, file.losses, time.perf_counter() - began]))
(peak,) = [line for line in open("/proc/self/status") if line.startswith("VmHWM")]  # of this program, not of who started it
print(int(peak.split()[1]))
"""


def test_hostile_files_cost_neither_time_nor_memory(tmp_path: Path) -> None:
    """All of them in one process, whose peak of memory is that of the worst."""
    paths = [_file(tmp_path / f"{k}.mcap", make()) for k, make in enumerate(HOSTILE.values())]
    done = subprocess.run([sys.executable, "-c", _LOOK, *map(str, paths)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    *rows, peak_kib = map(json.loads, done.stdout.splitlines())
    for name, (messages, losses, seconds) in zip(HOSTILE, rows, strict=True):
        assert messages == 0, name
        assert losses, name
        assert seconds < 5.0, name
    assert peak_kib < 1 << 20


def test_a_larger_chunk_is_read_where_it_is_allowed(tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", list(range(3000)), chunk_size=2 << 20)
    assert len(numbers(tmp_path / "x.mcap", limits=Limits(chunk_mib=1))) < 3000
    assert len(numbers(tmp_path / "x.mcap", limits=Limits(chunk_mib=4))) == 3000


def test_a_clock_that_stands_still_does_not_fill_the_memory(tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", [0] * 3000, chunk_size=20_000)
    assert len(numbers(tmp_path / "x.mcap")) == 3000
    with pytest.raises(LogError, match="--max-buffer-mib"):
        numbers(tmp_path / "x.mcap", limits=Limits(buffer_mib=1))


def test_stamps_that_leap_cost_only_themselves(tmp_path: Path) -> None:
    """In files without checksums: a flipped bit in a header's stamp, also in the first and the last message."""
    write(tmp_path / "x.mcap", list(range(100)), use_chunking=False)
    data = (tmp_path / "x.mcap").read_bytes()
    messages = [start for opcode, start, _ in records(data) if opcode == 0x05]
    for k in (0, 1, 50, 98):
        for seconds in (30, 1 << 20, 1 << 30):
            flipped = bytearray(data)
            at = messages[k] + 9 + 22 + 4
            (stamp,) = struct.unpack_from("<i", flipped, at)
            struct.pack_into("<i", flipped, at, min(stamp + seconds, (1 << 31) - 1))
            found, log, _ = _read(tmp_path / "y.mcap", bytes(flipped))
            assert found == [n for n in range(100) if n != k]
            assert log.dropped.counts == {"leap of time": 1}


def test_leaps_one_behind_the_other_and_at_the_end_cost_only_themselves(tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", list(range(100)), use_chunking=False)
    data = bytearray((tmp_path / "x.mcap").read_bytes())
    messages = [start for opcode, start, _ in records(bytes(data)) if opcode == 0x05]
    for k in (50, 51, 99):
        struct.pack_into("<i", data, messages[k] + 9 + 22 + 4, 2_100_000_000)
    found, log, _ = _read(tmp_path / "y.mcap", bytes(data))
    assert found == [n for n in range(100) if n not in (50, 51, 99)]
    assert log.dropped.counts == {"leap of time": 3}


def test_a_pause_of_minutes_loses_nothing(tmp_path: Path) -> None:
    order = [*range(50), *range(9000, 9050), 12_000]
    for kind in ("zstd", "unchunked"):
        write(tmp_path / "x.mcap", order, **ODD[kind])
        assert numbers(tmp_path / "x.mcap") == order


def test_a_wrong_checksum_costs_nothing_whatever_the_next_stamp_is(tmp_path: Path) -> None:
    """Messages of a chunk whose checksum is wrong wait for the next chunk, whose first stamp may be none."""
    write(tmp_path / "x.mcap", list(range(100)), compression=CompressionType.NONE, chunk_size=20_000)
    data, chunks = bytearray((tmp_path / "x.mcap").read_bytes()), _chunks(tmp_path / "x.mcap")
    data[chunks[1][0] + 9 + 24] ^= 1  # the checksum itself
    (first,) = [start for opcode, start, _ in _inner(bytes(data), chunks[2]) if opcode == 0x05][:1]
    struct.pack_into("<i", data, first + 9 + 22 + 4, -5)
    found, log, _ = _read(tmp_path / "y.mcap", bytes(data))
    lost = chunks[0][2] + chunks[1][2]
    assert found == [n for n in range(100) if n != lost]
    assert log.dropped.counts["bad stamp"] == 1
    assert "leap of time" not in log.dropped.counts


def _inner(data: bytes, chunk: tuple[int, int, int]) -> list[tuple[int, int, int]]:
    """Records of an uncompressed chunk, by their place in the file."""
    found, at = [], chunk[0] + 9 + 40
    while at < chunk[1]:
        opcode, length = struct.unpack_from("<BQ", data, at)
        found.append((opcode, at, at + 9 + length))
        at += 9 + length
    return found


def test_a_clock_that_is_set_goes_on(tmp_path: Path) -> None:
    """1970 until the network was there: legal, and nothing is lost."""
    with LogWriter(tmp_path / "x.mcap") as made:
        for k in range(100):
            made.odometry(Odometry(k * 10**8 + (T0 if k >= 20 else 0), 0.1 * k, 0.0, 0.0))
    log = Log(tmp_path / "x.mcap")
    assert numbers(log) == list(range(100))
    assert not log.dropped


def test_a_frame_that_a_flipped_bit_made_is_no_frame(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "x.mcap") as log:
        log.tf_static(T0, [("base_link", "laser", Pose2(0.1, 0.0, 0.0))])
        for k, frame in enumerate(("laser", "laser", "lasdr", "laser")):
            log.scan(Scan(T0 + k, np.ones(3, np.float32), 0.0, 0.1, 0.0, 9.0, Pose2()), frame=frame)
    opened = Log(tmp_path / "x.mcap")
    assert len(list(opened.events(["scan"]))) == 3
    assert "lasdr" in opened.dropped.notes[0]


@pytest.mark.parametrize(
    ("schema", "fields", "says"),
    [
        ("pfcli.Odometry", {"x_m": 1e200, "y_m": 0.0, "yaw_rad": 0.0}, "pose that cannot be"),
        ("pfcli.Odometry", {"x_m": 10**400, "y_m": 0.0, "yaw_rad": 0.0}, "schema"),
        ("pfcli.LaserScan", {"ranges_m": [1, 2], "angle_min_rad": 0, "angle_increment_rad": 0}, "angle_increment"),
        ("pfcli.LaserScan", {"ranges_m": [1, 2], "angle_min_rad": 0, "angle_increment_rad": 99}, "four turns"),
        ("pfcli.LaserScan", {"ranges_m": "no", "angle_min_rad": 0, "angle_increment_rad": 1}, "message"),
        ("pfcli.Pose2D", {"x_m": 0.0, "y_m": -1e12, "yaw_rad": 0.0}, "pose that cannot be"),
        ("pfcli.WheelEncoders", {"names": ["l", "r"], "ticks": [1, 2**70], "ticks_per_turn": 9}, "schema"),
        ("pfcli.Heading", {"yaw_rad": 1e300}, "heading that cannot be"),
    ],
)
def test_impossible_values_are_counted(schema: str, fields: dict[str, object], says: str, tmp_path: Path) -> None:
    role = next(role for role, kinds in ROLES.items() if schema in kinds)
    with LogWriter(tmp_path / "x.mcap") as log:
        log.raw(f"/the_{role}", schema, T0, json.dumps({"stamp_ns": T0, "frame_id": "base_link", **fields}).encode())
        log.raw(f"/the_{role}", schema, T0, b"[" * 100_000)
    opened = Log(tmp_path / "x.mcap", Settings(topics={role: f"/the_{role}"}))
    assert list(opened.events([role])) == []
    assert opened.dropped.counts == {"unreadable message": 1, "bad stamp": 1}
    assert says in "".join(opened.dropped.notes)


@pytest.mark.parametrize(
    ("stamp", "read"), [(0, True), ((1 << 62) - 1, True), (1 << 62, False), (-1, False), (1 << 63, False)]
)
def test_stamps_at_the_edges_are_right_or_refused(stamp: int, read: bool, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "x.mcap") as log:
        for k in range(3):
            text = json.dumps({"stamp_ns": stamp - k * (stamp > 5), "x_m": 1.0, "y_m": 0.0, "yaw_rad": 0.0})
            log.raw("/odom", "pfcli.Odometry", 5, text.encode())
    opened = Log(tmp_path / "x.mcap")
    stamps = [event.stamp_ns for event in opened.events(["odometry"])]
    assert stamps == (sorted(stamp - k * (stamp > 5) for k in range(3)) if read else stamps)
    assert all(0 <= s < 1 << 62 for s in stamps)
    assert len(stamps) + opened.dropped.counts["bad stamp"] == 3


# --- maps and texts ------------------------------------------------------------------------------------------

_MAP = "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n"


@pytest.mark.parametrize(
    ("text", "image", "says"),
    [
        ("a: &a [x, x]\nb: &b [*a, *a]\nresolution: *b\n", b"", "aliases"),
        ("resolution: !!python/object/apply:os.system [true]\n", b"", "map YAML"),
        ("[" * 5000, b"", "map YAML"),
        ("x: " + "a" * (5 << 20), b"", "longer than 4 MiB"),
        (_MAP, b"P5\n100000 100000\n255\n", "100000 x 100000 pixels"),
        (_MAP, b"P5\n10 10\n255\n" + bytes(7), "cannot be read as an image"),
        (_MAP, b"", "cannot be read as an image"),
        ('image: "a\\0b"\nresolution: 0.05\norigin: [0, 0, 0]\n', b"", "cannot be there"),
        (_MAP.replace("0.05", ".inf"), b"", "resolution"),
    ],
)
def test_hostile_maps_are_one_line(text: str, image: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(text)
    (tmp_path / "map.pgm").write_bytes(image)
    with pytest.raises(LogError, match=says) as caught:
        map_yaml.read(tmp_path / "map.yaml")
    assert "\n" not in str(caught.value)


def test_texts_without_end_are_one_line(tmp_path: Path) -> None:
    """Megabytes without a line's end in a hundred bytes of bzip2, and compressed files that are cut or are none."""
    whole = bz2.compress(bytes(5 << 20))
    for name, data in {
        "a.log.bz2": whole,
        "b.log.bz2": whole[:50],
        "c.log.gz": b"no",
        "d.log.gz": b"\x1f\x8b\x08",
    }.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(LogError, match="cannot be read as a CARMEN log"):
            carmen.read(tmp_path / name)
