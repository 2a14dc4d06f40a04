"""MCAP files in file order, so that a truncated or damaged log gives all that can be read before and after the damage.

The walk needs no index, summary or footer; where the file has them, they say what is missing.
"""

import mmap
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfcli.errors import LogError, printable, reason
from pfcli.formats import mcap_records as records
from pfcli.formats.limits import DEFAULTS
from pfcli.formats.mcap_chunks import Chunk, open_chunk, salvage
from pfcli.formats.mcap_damage import Damage
from pfcli.formats.mcap_records import MAGIC, Records, Walk
from pfcli.formats.mcap_summary import ChunkIndex, chunk_index, statistics
from pfcli.formats.reader import EVERYTHING, Batch, Channel, Span, Wanted, span_of

_PAGES = 1 << 24
_DECLARING = (records.SCHEMA, records.CHANNEL, records.STATISTICS, records.CHUNK_INDEX)


class McapFile:
    """One MCAP file: its channels, its messages in file order, and what was lost on the way.

    max_chunk_mib: a chunk that holds more is left out; shown: what messages call the file.
    """

    def __init__(self, path: Path, max_chunk_mib: float = DEFAULTS.chunk_mib, shown: Path | None = None) -> None:
        self.path = shown or path
        self.channels: dict[int, Channel] = {}
        self._damage = Damage(self.path)
        self.missing = 0
        """Messages that the file's own statistics count and the walk did not find."""
        self._limit = int(max_chunk_mib * 2**20)
        self._schemas: dict[int, tuple[str, str, bytes]] = {0: ("", "", b"")}
        self._known = np.zeros(65536, np.bool_)
        self._claimed: Span | None = None
        self._chunks: dict[int, ChunkIndex] = {}
        self._forgotten = 0
        self._wanted, self._passed, self._passing = EVERYTHING, 0, False
        self._spread: frozenset[int] = frozenset()
        try:
            if path.is_dir():
                raise LogError(f"{path}: is a folder; name the .mcap file in it")
            if path.stat().st_size == 0:
                raise LogError(f"{path}: is empty; nothing was recorded")
            with open(path, "rb") as file:
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            self._view = memoryview(self._map)
            self._bytes = np.frombuffer(self._view, np.uint8)
        except (OSError, ValueError) as error:
            raise LogError(f"{path}: cannot be read ({reason(error)})") from None
        if bytes(self._bytes[:8]) != MAGIC:
            raise LogError(f"{path}: is not an MCAP file")

    @property
    def profile(self) -> str:
        """What the header says of the recorder's conventions, such as `ros2`; '' where it cannot be read."""
        head = bytes(self._view[8 : 8 + 9 + 64])
        try:
            return records.string(head, 9)[0] if head[0] == records.HEADER else ""
        except (struct.error, UnicodeDecodeError, IndexError):
            return ""

    @property
    def extras(self) -> Iterator[tuple[int, bytes]]:
        """Opcode and body of the attachments and metadata at the top level."""
        walk = Walk(self._bytes, self._known, len(MAGIC))
        while walk.more:
            for opcode, offset, length in walk.step().others.tolist():
                if opcode in (records.ATTACHMENT, records.METADATA):
                    yield opcode, bytes(self._view[offset : offset + length])

    @property
    def losses(self) -> list[str]:
        """What could not be read on the last walk."""
        return self._damage.losses

    @property
    def files(self) -> list[Path]:
        """The file."""
        return [self.path]

    def survey(self) -> None:
        """Fill `channels` from the summary section, or by a walk where the file has none."""
        if not self._read_summary():
            for _ in self.batches():
                pass

    def span(self) -> Span | None:
        """Times and count as the summary has them, or by a walk."""
        if self._claimed is not None:
            return self._claimed if self._claimed.messages else None
        return span_of(self.batches())

    def _read_summary(self) -> bool:
        data = self._bytes
        foot = data.size - 8 - 29
        if foot < 8 or bytes(data[-8:]) != MAGIC:
            return False
        opcode, length, start, _, crc = struct.unpack("<BQQQI", data[foot : foot + 29].tobytes())
        if opcode != records.FOOTER or length != 20 or not 8 <= start < foot:
            return False
        if crc and zlib.crc32(self._view[start : foot + 25]) != crc:
            return False
        walk = Walk(data[start:foot], self._known)
        while walk.more:
            found = walk.step()
            self._declare(self._view[start:foot], found.others)
            if found.gaps.size:
                return False
        if not crc:  # what no checksum covers is not believed
            self._claimed = None
            self._chunks = {}
        return bool(self.channels)

    def batches(self, wanted: Wanted = EVERYTHING) -> Iterator[Batch]:
        """Messages, a buffer at a time, in file order; what cannot be read is noted in `losses`.

        Chunks that the summary says to hold nothing that is wanted are passed over.
        """
        self._damage.clear()
        self._forgotten = 0
        self._wanted, self._passed = wanted, 0
        self._spread = self._some(wanted)
        count, last = 0, 0
        walk = Walk(self._bytes, self._known, len(MAGIC))
        while walk.more:
            found = walk.step()
            self._declare(self._view, found.others)
            for batch in self._in_order(found):
                count += len(batch.channel)
                self._damage.see(batch)
                yield batch
            self._pass(found.others)
            last = int(found.others[-1, 0]) if len(found.others) else last
            if last == records.DATA_END:
                self._check_data(int(found.others[-1, 1]))
        if last not in (records.DATA_END, records.FOOTER) and not self._damage:
            self.lose("ends without a footer; the recorder was stopped hard")
        claimed = self._claimed.messages if self._claimed is not None else 0
        self.missing = max(0, claimed - count - self._passed)
        self._damage.finish(self._bytes.size, self._claimed, self.missing)

    def _some(self, wanted: Wanted) -> frozenset[int]:
        """Where the chunks begin that are asked for, of those that hold what is wanted."""
        if not wanted.pieces:
            return frozenset(self._chunks)
        holding = sorted(at for at, index in self._chunks.items() if index.holds(wanted))
        return frozenset(holding[:: -(-len(holding) // wanted.pieces) or 1])

    def _is_wanted(self, begin: int) -> bool:
        """Whether the chunk whose record begins at a byte may hold something wanted."""
        index = self._chunks.get(begin)
        return index is None or (begin in self._spread and index.holds(self._wanted))

    def _pass(self, others: NDArray[np.int64]) -> None:
        """Count the messages of the chunks that were passed over by the message indexes behind them."""
        if self._wanted == EVERYTHING:
            return
        for opcode, offset, length in others.tolist():
            if opcode == records.CHUNK:
                self._passing = not self._is_wanted(offset - 9)
            elif opcode == records.MESSAGE_INDEX and self._passing:
                self._passed += (length - 6) // 16

    def _in_order(self, found: Records) -> Iterator[Batch]:
        """Messages at the top level, in chunks and in what is left of chunks, by their place in the file."""
        chunks = found.others[found.others[:, 0] == records.CHUNK, 1:]
        places = [(at, at + length, False) for at, length in chunks.tolist()]
        places += [(begin, end, True) for begin, end in found.gaps.tolist()]
        rows = found.messages
        for begin, end, damaged in sorted(places):
            self._forget(begin)
            before = np.searchsorted(rows[:, 4], begin)
            if before:
                yield self._top(rows[:before])
                rows = rows[before:]
            yield from self._gap(begin, end) if damaged else self._chunk(begin, end)
        if len(rows):
            self._forget(int(rows[0, 4]))
            yield self._top(rows)

    def _top(self, rows: NDArray[np.int64]) -> Batch:
        """Messages outside of chunks; the batch holds on to no more than the bytes between its first and last."""
        begin, end = int(rows[0, 4]), int(rows[-1, 4] + rows[-1, 5])
        return _batch(self._view[begin:end], rows, begin)

    def _forget(self, position: int) -> None:
        """Let go of the pages before a position: they can be read again, and would count as memory until then."""
        if hasattr(self._map, "madvise") and position // _PAGES > self._forgotten:
            self._forgotten = position // _PAGES
            self._map.madvise(mmap.MADV_DONTNEED, 0, self._forgotten * _PAGES)

    def lose(self, what: str) -> None:
        """Note what cannot be read, or not as it was."""
        self._damage.lose(what)

    def _check_data(self, at: int) -> None:
        """The checksum of everything before the record of the data's end, where the recorder made one."""
        (crc,) = struct.unpack_from("<I", self._view, at)
        if crc and not self._damage and not self._passed and zlib.crc32(self._view[: at - 9]) != crc:
            self.lose("its data fail their checksum; they are used as far as they can be")

    def _chunk(self, begin: int, end: int) -> Iterator[Batch]:
        if not self._is_wanted(begin - 9):
            self._damage.skip()
            return
        chunk = open_chunk(self._view[begin:end], self._limit)
        if chunk.trouble:
            self._damage.lose(f"chunk at byte {begin - 9} {chunk.trouble}", timed=True)
        yield from self._inside(chunk, begin - 9)

    def _gap(self, begin: int, end: int) -> Iterator[Batch]:
        """Bytes that are no sane record; maybe they were a chunk."""
        self._damage.gap(begin, end, bytes(self._view[begin : min(end, begin + 64)]), self._bytes.size)
        chunk = salvage(self._view[begin + 9 : end], self._limit)
        if chunk is not None:
            yield from self._inside(chunk, begin)

    def _inside(self, chunk: Chunk, where: int) -> Iterator[Batch]:
        if not chunk.records:
            return
        walk = Walk(np.frombuffer(chunk.records, np.uint8), self._known)
        while walk.more:
            found = walk.step()
            self._declare(chunk.records, found.others)
            if found.messages.size:
                yield _batch(chunk.records, found.messages)._replace(sure=not chunk.trouble)
            if found.gaps.size and not chunk.trouble:
                self.lose(f"chunk at byte {where} holds bytes that are no record")

    def _declare(self, data: bytes | memoryview, others: NDArray[np.int64]) -> None:
        """Take up the schema, channel and statistics records among `others`."""
        for opcode, offset, length in others.tolist():
            if opcode not in _DECLARING:
                continue
            body = bytes(data[offset : offset + length])
            try:
                if opcode == records.SCHEMA:
                    self._declare_schema(body)
                elif opcode == records.CHANNEL:
                    self._declare_channel(body)
                elif opcode == records.STATISTICS:
                    self._claimed = statistics(body)
                else:
                    start, index = chunk_index(body)
                    self._chunks[start] = index
            except (struct.error, UnicodeDecodeError):
                self.lose(f"a schema, channel or index record of {length} bytes cannot be read")

    def _declare_schema(self, body: bytes) -> None:
        (ident,) = struct.unpack_from("<H", body)
        name, at = records.string(body, 2)
        encoding, at = records.string(body, at)
        self._schemas[ident] = (name, encoding, records.blob(body, at)[0])

    def _declare_channel(self, body: bytes) -> None:
        ident, schema = struct.unpack_from("<HH", body)
        topic, at = records.string(body, 4)
        encoding, at = records.string(body, at)
        metadata, _ = records.blob(body, at)
        kind = self._schemas.get(schema, ("", "", b""))
        declared = Channel(ident, topic, encoding, *kind, metadata)
        if self.channels.get(ident, declared)[:3] != declared[:3]:
            self.lose(f"channel {ident} is declared anew, as the topic {printable(topic)!r}: its messages are mixed up")
        self.channels[ident] = declared


def _batch(data: bytes | memoryview, rows: NDArray[np.int64], start: int = 0) -> Batch:
    channel, sequence, log, publish, offset, length = rows.T.copy()
    return Batch(data, channel, log, publish, sequence, offset - start, length)
