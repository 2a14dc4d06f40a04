"""MCAP records in file order, so that a truncated or damaged log gives all that can be read.

The walk needs no index, summary or footer. Message records are indexed by a kernel, a chunk at a time; nothing is
decoded here. Source: the MCAP specification, version 0.
"""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import kernel
from pfcli.errors import LogError, printable, reason

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END, _FOOTER = 0x03, 0x04, 0x05, 0x06, 0x0F, 0x02
_BATCH = 8192
MAX_CHUNK = 1 << 30
"""A chunk that claims more than this many bytes is taken for damage."""


class Channel(NamedTuple):
    """A channel with its schema, as the file declares them."""

    id: int
    topic: str
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


class Batch(NamedTuple):
    """Messages of one buffer: channel ids, times (ns), sequence and the place of each payload in `data`."""

    data: bytes | memoryview
    channel: NDArray[np.int64]
    log_ns: NDArray[np.int64]
    publish_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    offset: NDArray[np.int64]
    length: NDArray[np.int64]


@kernel
def _index(buffer, start, out, others):  # type: ignore[no-untyped-def]
    """Index records from `start`: messages into out (n, 6), all else into others (n, 3) as opcode, offset, length.

    Returns (next position, messages, others, state): state 0 at the end, 1 when the tables are full, 2 when the
    record at the position is cut off.
    """
    position, count, rest = start, 0, 0
    while position < buffer.size:
        if count == out.shape[0] or rest == others.shape[0]:
            return position, count, rest, 1
        if position + 9 > buffer.size:
            return position, count, rest, 2
        length = np.int64(0)
        for k in range(8):
            length |= np.int64(buffer[position + 1 + k]) << (8 * k)
        if length < 0 or length > buffer.size - position - 9:
            return position, count, rest, 2
        opcode, body = buffer[position], position + 9
        if opcode == 0x05 and length >= 22:
            out[count, 0] = np.int64(buffer[body]) | np.int64(buffer[body + 1]) << 8
            for k in range(3):
                value, width, at = np.int64(0), (4 if k == 0 else 8), body + (2, 6, 14)[k]
                for j in range(width):
                    value |= np.int64(buffer[at + j]) << (8 * j)
                out[count, 1 + k] = value
            out[count, 4] = body + 22
            out[count, 5] = length - 22
            count += 1
        else:
            others[rest, 0], others[rest, 1], others[rest, 2] = opcode, body, length
            rest += 1
        position = body + length
        if opcode == 0x0F or opcode == 0x02:
            return position, count, rest, 0
    return position, count, rest, 0


class McapFile:
    """One MCAP file: its channels, its messages in file order, and what was lost on the way."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.losses: list[str] = []
        self.partial = False
        self._schemas: dict[int, tuple[str, str, bytes]] = {0: ("", "", b"")}
        try:
            if path.is_dir():
                raise LogError(f"{path}: is a folder; name the .mcap file in it")
            size = path.stat().st_size
            if size == 0:
                raise LogError(f"{path}: is empty; nothing was recorded")
            self._bytes = np.memmap(path, np.uint8, mode="r")
            self._view = memoryview(self._bytes.data)
        except OSError as error:
            raise LogError(f"{path}: cannot be read ({reason(error)})") from None
        if bytes(self._bytes[:8]) != MAGIC:
            raise LogError(
                f"{path}: is not an MCAP file; `pfcli convert` makes one from CARMEN logs, ROS bags and logs of wheel ticks"
            )

    def survey(self) -> None:
        """Fill `channels` from the summary section, or by a walk where the file has none."""
        if not self._read_summary():
            for _ in self.batches():
                pass
            self.losses.clear()
            self.partial = False

    def _read_summary(self) -> bool:
        data = self._bytes
        if data.size < 8 + 9 + 20 + 8 or bytes(data[-8:]) != MAGIC:
            return False
        foot = data.size - 8 - 29
        opcode, length, start = struct.unpack_from("<BQQ", data[foot : foot + 29].tobytes())
        if opcode != _FOOTER or length != 20 or not 8 <= start < foot:
            return False
        summary = data[start:foot].tobytes()
        rows, others = np.empty((1, 6), np.int64), np.empty((65536, 3), np.int64)
        _, _, rest, state = _index(np.frombuffer(summary, np.uint8), 0, rows, others)
        self._declare(summary, others[:rest])
        return state == 0 and bool(self.channels)

    def batches(self) -> Iterator[Batch]:
        """Messages, a buffer at a time, in file order; what cannot be read is noted in `losses`."""
        others = np.empty((_BATCH, 3), np.int64)
        position, state, opcode = 8, 1, 0
        data = self._bytes
        while state == 1:
            rows = np.empty((_BATCH, 6), np.int64)
            start = position
            position, count, rest, state = _index(data, position, rows, others)
            top = self._view[start:position]
            tables = others[:rest].copy()
            tables[:, 1] -= start
            self._declare(top, tables)
            if count:
                rows = rows[:count]
                rows[:, 4] -= start
                yield _batch(top, rows)
            for opcode, offset, length in tables.tolist():
                if opcode == _CHUNK:
                    yield from self._chunk(top[offset : offset + length], start + offset)
        if state == 2 and position + 9 < data.size and data[position] == _CHUNK:
            self._lose(f"cut off inside a chunk at byte {position}")
            yield from self._chunk(self._view[position + 9 :], position + 9, cut=True)
        elif state == 2:
            self._lose(f"cut off at byte {position}")
        elif opcode not in (_DATA_END, _FOOTER):
            self._lose("ends without a footer; the recorder was stopped hard")

    def _lose(self, what: str) -> None:
        self.partial = True
        self.losses.append(f"{self.path}: {what}")

    def _chunk(self, record: memoryview, where: int, *, cut: bool = False) -> Iterator[Batch]:
        try:
            size, crc, name_length = struct.unpack_from("<QII", record, 16)
            compression = bytes(record[32 : 32 + name_length]).decode("ascii", "replace")
            if len(compression) > 16:
                raise struct.error
            (stored,) = struct.unpack_from("<Q", record, 32 + name_length)
        except struct.error:
            self._lose(f"chunk at byte {where} has no readable header")
            return
        if size > MAX_CHUNK:
            self._lose(f"chunk at byte {where} claims {size} bytes")
            return
        body = record[40 + name_length : 40 + name_length + stored]
        records, whole = _decompress(compression, body, size, cut=cut)
        if not whole and not cut:
            self._lose(
                f"chunk at byte {where} ({printable(compression) or 'uncompressed'}) cannot be decompressed whole"
            )
        elif not cut and crc and zlib.crc32(records) != crc:
            self._lose(f"chunk at byte {where} fails its checksum; its messages are used as far as they can be")
        yield from self._records(records, where)

    def _records(self, records: bytes | memoryview, where: int) -> Iterator[Batch]:
        view = np.frombuffer(records, np.uint8)
        position, state = 0, 1
        others = np.empty((1024, 3), np.int64)
        while state == 1:
            rows = np.empty((_BATCH, 6), np.int64)
            position, count, rest, state = _index(view, position, rows, others)
            self._declare(records, others[:rest])
            if count:
                yield _batch(records, rows[:count])
        if state == 2 and not self.partial:
            self._lose(f"chunk at byte {where} ends inside a record")

    def _declare(self, data: bytes | memoryview, records: NDArray[np.int64]) -> None:
        """Take up the schema and channel records among `records`."""
        for opcode, offset, length in records.tolist():
            body = bytes(data[offset : offset + length]) if opcode in (_SCHEMA, _CHANNEL) else b""
            try:
                if opcode == _SCHEMA:
                    (ident,) = struct.unpack_from("<H", body)
                    name, at = _string(body, 2)
                    encoding, at = _string(body, at)
                    (size,) = struct.unpack_from("<I", body, at)
                    self._schemas[ident] = (name, encoding, body[at + 4 : at + 4 + size])
                elif opcode == _CHANNEL:
                    ident, schema = struct.unpack_from("<HH", body)
                    topic, at = _string(body, 4)
                    encoding, at = _string(body, at)
                    self.channels[ident] = Channel(ident, topic, encoding, *self._schemas.get(schema, ("", "", b"")))
            except (struct.error, UnicodeDecodeError):
                self._lose(f"a schema or channel record of {length} bytes cannot be read")


def _string(body: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", body, at)
    if at + 4 + length > len(body):
        raise struct.error
    return body[at + 4 : at + 4 + length].decode(), at + 4 + length


def _batch(data: bytes | memoryview, rows: NDArray[np.int64]) -> Batch:
    columns = rows.T.copy()
    return Batch(data, columns[0], columns[2], columns[3], columns[1], columns[4], columns[5])


def _decompress(name: str, body: memoryview, size: int, *, cut: bool) -> tuple[bytes | memoryview, bool]:
    """Records of a chunk and whether all of them are there; of a damaged chunk what comes before the damage."""
    if name == "":
        return body, len(body) == size
    if name == "zstd":
        import zstandard

        if not cut:
            try:
                whole = zstandard.ZstdDecompressor().decompress(body, max_output_size=size)
                return whole, len(whole) == size
            except zstandard.ZstdError:
                pass
        return _piecewise(zstandard.ZstdDecompressor().decompressobj(), body, size, zstandard.ZstdError), False
    if name == "lz4":
        import lz4.frame

        if not cut:
            try:
                whole = lz4.frame.decompress(body)
                return whole, len(whole) == size
            except (RuntimeError, EOFError):
                pass
        return _piecewise(lz4.frame.LZ4FrameDecompressor(), body, size, (RuntimeError, EOFError)), False
    return b"", False


def _piecewise(stream: object, body: memoryview, size: int, errors: object) -> bytes:
    """Decompress in small pieces until the data or its claimed size ends."""
    out = bytearray()
    for start in range(0, len(body), 1024):
        try:
            out += stream.decompress(bytes(body[start : start + 1024]))  # type: ignore[attr-defined]
        except errors:  # type: ignore[misc]
            break
        if len(out) >= size:
            break
    return bytes(out[:size])
