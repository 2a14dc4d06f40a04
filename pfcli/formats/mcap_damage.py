"""What is wrong with an MCAP file, said once for each place and in the user's terms: seconds and messages, not only bytes."""

import struct
from pathlib import Path

from pfcli.formats.mcap_records import CHUNK
from pfcli.formats.reader import Batch, Span

_SECOND = 1_000_000_000


class Damage:
    """Notes what cannot be read while the messages go by."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.losses: list[str] = []
        self.clear()

    def clear(self) -> None:
        """Begin anew, for another walk through the file."""
        self.losses.clear()
        self._first: int | None = None
        self._last = 0
        self._count = 0
        self._open: list[int] = []
        self._cut_chunk: tuple[int, int] | None = None

    def __bool__(self) -> bool:
        return bool(self.losses) or self._cut_chunk is not None

    def see(self, batch: Batch) -> None:
        """Messages that could be read; they say how long the damage before them lasted."""
        if not len(batch.log_ns):
            return
        first, last = int(batch.log_ns.min()), int(batch.log_ns.max())
        pause_s = (first - self._last) / _SECOND
        for index in self._open:
            if self._first is not None and pause_s > 0:
                self.losses[index] += f"; no message of {pause_s:.3f} s there could be read"
        self._open.clear()
        self._last = last if self._first is None else max(self._last, last)
        self._first = first if self._first is None else min(self._first, first)
        self._count += len(batch.log_ns)

    def skip(self) -> None:
        """What is passed over says nothing of the damage before it."""
        self._open.clear()

    def lose(self, what: str, *, timed: bool = False) -> None:
        """Note what cannot be read, or not as it was; `timed`: the next message tells how long it lasted."""
        if timed:
            self._open.append(len(self.losses))
        self.losses.append(f"{self._path}: {what}")

    def gap(self, begin: int, end: int, head: bytes, size: int) -> None:
        """Bytes [begin, end) of a file of `size` that are no sane record, of which these are the first."""
        opcode, length = struct.unpack_from("<BQ", head) if len(head) >= 9 else (0, 0)
        if opcode == CHUNK and begin + 9 + length > size and len(head) >= 25:
            self._cut_chunk = begin, struct.unpack_from("<q", head, 17)[0]
            if end < size:  # its records are not compressed: they follow, up to the cut
                return
        if end < size:
            self.lose(f"is damaged from byte {begin} to {end}", timed=True)
        elif self._cut_chunk is None:
            self.lose(f"is cut off at byte {end}, inside the record at byte {begin}; nothing tells what followed")

    def finish(self, size: int, claimed: Span | None, missing: int) -> None:
        """The file has ended. claimed: what its summary says that it holds."""
        self._open.clear()
        if self._cut_chunk is not None:
            begin, last = self._cut_chunk
            self.lose(f"is cut off at byte {size}, inside the chunk at byte {begin}: {self._tail(last)}")
        if missing and claimed is not None:
            where = f"; the last {self._tail_s(claimed.last_ns):.3f} s are lost" if self._ends_early(claimed) else ""
            self.lose(f"{missing} of {claimed.messages} messages could not be read{where}")

    def _ends_early(self, claimed: Span) -> bool:
        return self._first is not None and claimed.last_ns > self._last

    def _tail_s(self, last_ns: int) -> float:
        return (last_ns - self._last) / _SECOND

    def _tail(self, last_ns: int) -> str:
        """What is lost between the last message and a time."""
        lost_s = self._tail_s(last_ns)
        if self._first is None:
            return "nothing before it could be read"
        if lost_s <= 0:
            return "its last messages are there"
        lasted_s = (self._last - self._first) / _SECOND
        about = f", about {round(self._count / lasted_s * lost_s)} messages at the log's rate" if lasted_s > 0 else ""
        return f"the last {lost_s:.3f} s are lost{about}"
