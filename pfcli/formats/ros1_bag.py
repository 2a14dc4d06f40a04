"""ROS 1 bags (format 2.0), walked from the front: no index is believed, so that old and cut bags give all that they hold.

Source: http://wiki.ros.org/Bags/Format/2.0. Records: header length, header fields `name=value`, data length, data.
"""

import bz2
import mmap
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pfcli.errors import LogError, printable, reason
from pfcli.formats.limits import AS_IT_IS, Reading
from pfcli.formats.reader import EVERYTHING, Batch, Channel, Span, Wanted
from pfcli.formats.time_order import Piece, merged, piece_of

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION, _INDEXES = b"\x02", b"\x05", b"\x07", (b"\x04", b"\x06")
_U32 = struct.Struct("<I")
_MOST = 4096
"""So many messages outside of chunks make a batch."""
_SECOND = 1_000_000_000
_OP = b"\x04\x00\x00\x00op="
_LONGEST, _BEFORE_OP = 1 << 16, 512
"""No header is longer; and the field `op` stands in its first bytes."""

Row = tuple[int, int, int, int]
"""Connection, time (ns), offset and length of the payload."""


class Ros1Bag:
    """One bag; its messages keep their ROS 1 serialisation (`ros1`)."""

    def __init__(self, path: Path, reading: Reading = AS_IT_IS, shown: Path | None = None) -> None:
        self.path = shown or path
        self.channels: dict[int, Channel] = {}
        self.losses: list[str] = []
        self.missing = 0
        self._limit = int(reading.max_chunk_mib * 2**20)
        self._pieces: list[Piece] = []
        self._count = 0
        try:
            with open(path, "rb") as file:
                self._data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        except (OSError, ValueError) as error:
            raise LogError(f"{self.path}: cannot be read ({reason(error)})") from None

    @property
    def files(self) -> list[Path]:
        """The file."""
        return [self.path]

    def survey(self) -> None:
        """Connections stand beside the messages: all is walked, once; what cannot be read is noted here."""
        self._pieces = list(self._walk())

    def span(self) -> Span | None:
        """Of the messages that were found."""
        if not self._pieces:
            return None
        first, last = min(p.first_ns for p in self._pieces), max(p.last_ns for p in self._pieces)
        return Span(first, last, self._count)

    def batches(self, wanted: Wanted = EVERYTHING) -> Iterator[Batch]:
        """Messages in the order of the recorder's time, as the bag's index would give them."""
        return merged([piece for piece in self._pieces if piece.holds(wanted)])

    def _loose(self, rows: list[Row]) -> Piece:
        """Messages outside of chunks."""
        batch = self._batch(self._data, rows)
        self._count += len(rows)
        return piece_of(batch, lambda: batch)

    def _packed(self, begin: int, fields: dict[bytes, bytes], body: memoryview) -> Iterator[Piece]:
        """Messages of a chunk; it is decompressed again when its time comes."""
        batch = self._chunk(begin, fields, body)
        if batch is not None:
            self._count += len(batch.log_ns)
            yield piece_of(batch, lambda: self._chunk(begin, fields, body))

    def _walk(self) -> Iterator[Piece]:
        """The pieces, in the order of the file."""
        self.losses.clear()
        self._count = 0
        rows: list[Row] = []
        last, index, cut = len(MAGIC), False, False
        try:
            for begin, fields, at, end in _records(self._data, len(MAGIC)):
                if begin > last and not index:
                    if _runs_out(self._data, last):  # a chunk that is cut and not compressed: its records follow
                        cut = True
                    else:
                        self.losses.append(f"{self.path}: is damaged from byte {last} to {begin}")
                last, index = end, fields[b"op"] in _INDEXES
                if fields[b"op"] == _CHUNK:
                    if rows:
                        yield self._loose(rows)
                        rows = []
                    yield from self._packed(begin, fields, self._data[at:end])
                    continue
                self._take(fields, self._data, at, end, rows)
                if len(rows) == _MOST:
                    yield self._loose(rows)
                    rows = []
        except _Damage as damage:
            if not index:
                cut = True
                last = damage.at
        if cut:
            self.losses.append(
                f"{self.path}: is cut off inside the record at byte {last}; the file has {len(self._data)}"
            )
        if rows:
            yield self._loose(rows)

    def _chunk(self, begin: int, fields: dict[bytes, bytes], body: memoryview) -> Batch | None:
        try:
            data = self._decompressed(fields, body)
        except (OSError, ValueError, RuntimeError, EOFError, KeyError, struct.error) as error:
            self._lose(f"{self.path}: chunk at byte {begin} cannot be decompressed ({reason(error)})")
            return None
        rows: list[Row] = []
        try:
            for _, inner, at, end in _records(data, 0):
                self._take(inner, data, at, end, rows)
        except _Damage:
            self._lose(f"{self.path}: chunk at byte {begin} holds bytes that are no record")
        return self._batch(data, rows) if rows else None

    def _lose(self, note: str) -> None:
        """Note what cannot be read, once: chunks are opened again."""
        if note not in self.losses:
            self.losses.append(note)

    def _decompressed(self, fields: dict[bytes, bytes], body: memoryview) -> memoryview:
        kind, (size,) = fields[b"compression"], _U32.unpack(fields[b"size"])
        if size > self._limit:
            raise ValueError(f"it holds {size / 2**20:.0f} MiB; --max-chunk-mib reads larger ones")
        if kind == b"none":
            return body
        if kind == b"bz2":
            return memoryview(bz2.BZ2Decompressor().decompress(body, size))
        if kind == b"lz4":
            import lz4.frame

            return memoryview(lz4.frame.LZ4FrameDecompressor().decompress(body, max_length=size))
        raise ValueError(f"compression {printable(kind.decode('ascii', 'replace'))!r} is none of none, bz2, lz4")

    def _take(self, fields: dict[bytes, bytes], data: memoryview, at: int, end: int, rows: list[Row]) -> None:
        """A message or connection record."""
        kind = fields.get(b"op")
        try:
            if kind == _MESSAGE:
                (connection,) = _U32.unpack(fields[b"conn"])
                seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
                rows.append((connection, seconds * _SECOND + nanoseconds, at, end - at))
            elif kind == _CONNECTION:
                self._connect(fields, _fields(bytes(data[at:end])))
        except (KeyError, struct.error, UnicodeDecodeError):
            self.losses.append(f"{self.path}: a message or connection record lacks a field")

    def _connect(self, fields: dict[bytes, bytes], about: dict[bytes, bytes]) -> None:
        (ident,) = _U32.unpack(fields[b"conn"])
        topic = fields.get(b"topic") or about[b"topic"]
        text = about.get(b"message_definition", b"")
        self.channels[ident] = Channel(ident, topic.decode(), "ros1", about[b"type"].decode(), "ros1msg", text)

    def _batch(self, data: memoryview, rows: list[Row]) -> Batch:
        channel, stamp, offset, length = np.array(rows, np.int64).T.copy()
        return Batch(data, channel, stamp, stamp, np.zeros(len(rows), np.int64), offset, length)


class _Damage(Exception):
    """From a byte on nothing sane follows."""

    def __init__(self, at: int) -> None:
        super().__init__(at)
        self.at = at


def _records(data: memoryview, at: int) -> Iterator[tuple[int, dict[bytes, bytes], int, int]]:
    """Begin, header fields, begin and end of the data of each record. Raises _Damage.

    Lengths of index records are wrong in old bags: where nothing sane follows a record, the search begins inside it.
    """
    inside = at
    while at < len(data):
        record = _record(data, at)
        if record is None:
            found = _next(data, inside)
            if found is None:
                raise _Damage(at)
            at, inside = found, found + 1
            continue
        fields, begin, end = record
        yield at, fields, begin, end
        at, inside = end, begin


def _record(data: memoryview, at: int) -> tuple[dict[bytes, bytes], int, int] | None:
    """Header fields, begin and end of the data of the record at a byte; None where there is none."""
    if at + 8 > len(data):
        return None
    (length,) = _U32.unpack_from(data, at)
    begin = at + 8 + length
    if length > _LONGEST or begin > len(data):
        return None
    try:
        fields = _fields(bytes(data[at + 4 : at + 4 + length]))
    except struct.error:
        return None
    end = begin + int(_U32.unpack_from(data, begin - 4)[0])
    return (fields, begin, end) if b"op" in fields and end <= len(data) else None


def _runs_out(data: memoryview, at: int) -> bool:
    """Whether a record begins at a byte whose data end behind the file."""
    (length,) = _U32.unpack_from(data, at) if at + 4 <= len(data) else (len(data),)
    if at + 8 + length > len(data):
        return True
    (count,) = _U32.unpack_from(data, at + 4 + length)
    return bool(length <= _LONGEST and at + 8 + length + count > len(data))


def _next(data: memoryview, at: int) -> int | None:
    """Where the next sane record begins from a byte on: every header has a field `op`."""
    whole = bytes(data[at:])
    place = whole.find(_OP)
    while place >= 0:
        for start in range(max(0, place - _BEFORE_OP), place):
            if _record(data, at + start) is not None:
                return at + start
        place = whole.find(_OP, place + 1)
    return None


def _fields(header: bytes) -> dict[bytes, bytes]:
    """Fields of a header. Raises struct.error."""
    at, found = 0, {}
    while at < len(header):
        (length,) = _U32.unpack_from(header, at)
        name, equals, value = header[at + 4 : at + 4 + length].partition(b"=")
        if not equals or at + 4 + length > len(header):
            raise struct.error
        found[name] = value
        at += 4 + length
    return found
