"""What the summary section of an MCAP file says of its messages: counts, times, and what each chunk holds.

Source: the MCAP specification, version 0 (records Statistics and Chunk Index).
"""

import struct
from typing import NamedTuple

import numpy as np

from pfcli.formats.reader import Span, Wanted

_PAIR = np.dtype([("channel", "<u2"), ("offset", "<u8")])


class ChunkIndex(NamedTuple):
    """Log times of a chunk's first and last message (ns) and the channels that it has messages of."""

    begin_ns: int
    end_ns: int
    channels: frozenset[int]

    def holds(self, wanted: Wanted) -> bool:
        """Whether the chunk may hold something that is wanted."""
        if self.end_ns < wanted.begin_ns or self.begin_ns > wanted.end_ns:
            return False
        return wanted.channels is None or not self.channels or not self.channels.isdisjoint(wanted.channels)


def statistics(body: bytes) -> Span:
    """Count and times of a Statistics record. Raises struct.error."""
    (count,) = struct.unpack_from("<Q", body)
    first, last = struct.unpack_from("<qq", body, 26)
    return Span(first, last, count)


def chunk_index(body: bytes) -> tuple[int, ChunkIndex]:
    """Where in the file a chunk begins, and what a Chunk Index record says of it. Raises struct.error."""
    begin, end, start, _, size = struct.unpack_from("<qqQQI", body)
    if size % _PAIR.itemsize or 36 + size > len(body):
        raise struct.error
    pairs = np.frombuffer(body, _PAIR, size // _PAIR.itemsize, 36)
    return start, ChunkIndex(begin, end, frozenset(pairs["channel"].tolist()))
