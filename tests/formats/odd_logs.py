"""Logs of odometry as recorders of all kinds would write them, for the tests of odd and damaged files."""

import struct
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, IndexType, Writer

from pfcli.formats.messages import SECOND
from pfcli.formats.schemas import ros2msg
from pfcli.replay.log import Log
from pfcli.replay.settings import Settings

T0 = 1_700_000_000 * SECOND
ODOMETRY = "nav_msgs/msg/Odometry"

ODD: dict[str, dict[str, Any]] = {
    "zstd": {"compression": CompressionType.ZSTD, "chunk_size": 20_000},
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 20_000},
    "none": {"compression": CompressionType.NONE, "chunk_size": 20_000},
    "unchunked": {"use_chunking": False},
    "no summary": {
        "use_summary_offsets": False,
        "use_statistics": False,
        "repeat_channels": False,
        "repeat_schemas": False,
        "index_types": IndexType.NONE,
    },
    "no index": {"index_types": IndexType.NONE, "chunk_size": 20_000},
    "no checksums": {"enable_crcs": False, "chunk_size": 20_000},
    "checksum of everything": {"enable_data_crcs": True, "use_chunking": False},
}
"""Kind of file -> options of the mcap package's writer."""


def odometry(k: int) -> bytes:
    """Message k: 0.1 s and 0.1 m after the last."""
    body = struct.pack("<iI", T0 // SECOND + k // 10, k % 10 * 100_000_000)
    body += struct.pack("<I", 5) + b"odom\0" + bytes(3) + struct.pack("<I", 10) + b"base_link\0"
    body += bytes(-len(body) % 8)
    return b"\x00\x01\x00\x00" + body + struct.pack("<85d", 0.1 * k, 0, 0, 0, 0, 0, 1, *[0] * 78)


def write(path: Path, order: list[int], schema: tuple[str, str, bytes] | None = None, **options: Any) -> None:
    """Messages of these numbers; schema: name, encoding and text, None: as rosbag2 has it."""
    with open(path, "wb") as file:
        writer = Writer(file, **options)
        writer.start()
        name, encoding, text = schema or (ODOMETRY, "ros2msg", ros2msg(ODOMETRY).encode())
        kind = writer.register_schema(name, encoding, text) if name else 0
        channel = writer.register_channel("/odom", "cdr", kind)
        for k in order:
            stamp = T0 + k * 100_000_000
            writer.add_message(channel, stamp, odometry(k), stamp, k)
        writer.finish()


def numbers(log: Path | list[Path] | Log, **settings: Any) -> list[int]:
    """The numbers of the messages that a replay gives."""
    opened = log if isinstance(log, Log) else Log(log, Settings(**settings))
    return [round(event.x_m * 10) for event in opened.events(["odometry"])]  # type: ignore[union-attr]


def records(data: bytes) -> list[tuple[int, int, int]]:
    """Opcode, start and end of the records at the top level of a whole file."""
    found, at = [], 8
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        found.append((opcode, at, at + 9 + length))
        at += 9 + length
    return found
