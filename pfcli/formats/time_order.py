"""Pieces of a recording, each in the order of time, as one stream in the order of time; a piece is loaded when its time comes."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pfcli.formats.reader import Batch, Wanted


class Piece(NamedTuple):
    """First and last time of the messages (ns), the channels that they are of, and what gives them."""

    first_ns: int
    last_ns: int
    channels: frozenset[int]
    load: Callable[[], Batch | None]

    def holds(self, wanted: Wanted) -> bool:
        """Whether something wanted may be in it."""
        if self.last_ns < wanted.begin_ns or self.first_ns > wanted.end_ns:
            return False
        return wanted.channels is None or not self.channels.isdisjoint(wanted.channels)


def piece_of(batch: Batch, load: Callable[[], Batch | None]) -> Piece:
    """The piece that holds these messages."""
    channels = frozenset(np.unique(batch.channel).tolist())
    return Piece(int(batch.log_ns.min()), int(batch.log_ns.max()), channels, load)


def in_time(batch: Batch) -> Batch:
    """A batch in the order of time; messages of one time stay as they are."""
    return batch if (np.diff(batch.log_ns) >= 0).all() else batch.rows(np.argsort(batch.log_ns, kind="stable"))


def merged(pieces: Sequence[Piece]) -> Iterator[Batch]:
    """The messages of all pieces, cut where another piece goes on."""
    order = sorted(pieces, key=lambda piece: piece.first_ns)
    loaded: list[Batch] = []
    k = 0
    while loaded or k < len(order):
        loaded.sort(key=lambda batch: int(batch.log_ns[0]))
        if k < len(order) and (not loaded or order[k].first_ns <= int(loaded[0].log_ns[0])):
            found = order[k].load()
            loaded += [in_time(found)] if found is not None else []
            k += 1
            continue
        head = loaded.pop(0)
        limits = [int(batch.log_ns[0]) for batch in loaded[:1]] + [piece.first_ns for piece in order[k : k + 1]]
        count = max(1, int(np.searchsorted(head.log_ns, min(limits), "right"))) if limits else len(head.log_ns)
        yield head.rows(slice(0, count))
        if count < len(head.log_ns):
            loaded.append(head.rows(slice(count, None)))
