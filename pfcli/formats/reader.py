"""The border between containers and the replay: every container gives its channels, and its messages as batches of columns.

A reader is made for each container (`pfcli.formats.mcap_file` is the first); `pfcli.formats.recording` puts the parts of a
recording together, and is a reader itself. `pfcli.replay.log` knows nothing else of files.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

LONG_AGO_NS, NEVER_NS = -(1 << 63), (1 << 63) - 1


class Channel(NamedTuple):
    """A channel with its schema, as the file declares them."""

    id: int
    topic: str
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes
    metadata: bytes = b""


class Batch(NamedTuple):
    """Messages of one buffer, a column each: channel ids, times (ns), sequence and the place of each payload in `data`.

    sure: no checksum and no decompressor objects to them.
    """

    data: bytes | memoryview
    channel: NDArray[np.int64]
    log_ns: NDArray[np.int64]
    publish_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    offset: NDArray[np.int64]
    length: NDArray[np.int64]
    sure: bool = True

    def rows(self, chosen: slice | NDArray[np.int64] | NDArray[np.bool_]) -> "Batch":
        """Some of its messages, in the same buffer."""
        return self._replace(
            channel=self.channel[chosen],
            log_ns=self.log_ns[chosen],
            publish_ns=self.publish_ns[chosen],
            sequence=self.sequence[chosen],
            offset=self.offset[chosen],
            length=self.length[chosen],
        )


class Wanted(NamedTuple):
    """What a replay asks for: channel ids (None: all) and the log times (ns) that it can use; about so many pieces,
    spread over the recording, are enough (0: all).

    A hint: a reader may leave out what is not wanted where that saves work, and never has to.
    """

    channels: frozenset[int] | None = None
    begin_ns: int = LONG_AGO_NS
    end_ns: int = NEVER_NS
    pieces: int = 0


EVERYTHING = Wanted()


class Span(NamedTuple):
    """Log times of the first and last message (ns), and how many there are."""

    first_ns: int
    last_ns: int
    messages: int


class Reader(Protocol):
    """One recording, or a part of one, in whatever container.

    path: what messages call it; channels: by id.
    """

    path: Path
    channels: dict[int, Channel]

    @property
    def losses(self) -> list[str]:
        """What the last walk could not read."""
        ...

    @property
    def missing(self) -> int:
        """Messages that the container counts and the walk did not find."""
        ...

    @property
    def files(self) -> list[Path]:
        """The files that it reads."""
        ...

    def survey(self) -> None:
        """Fill `channels`, as cheaply as the container allows."""
        ...

    def span(self) -> Span | None:
        """When its messages were recorded; None where there is none."""
        ...

    def batches(self, wanted: Wanted = EVERYTHING) -> Iterator[Batch]:
        """Messages in the order of the file, a buffer at a time; what cannot be read is noted in `losses`."""
        ...


def span_of(batches: Iterable[Batch]) -> Span | None:
    """The span of messages, by looking at each."""
    found: Span | None = None
    for batch in batches:
        if not len(batch.log_ns):
            continue
        first, last = int(batch.log_ns.min()), int(batch.log_ns.max())
        if found is not None:
            first, last = min(first, found.first_ns), max(last, found.last_ns)
        found = Span(first, last, len(batch.log_ns) + (found.messages if found is not None else 0))
    return found
