"""A log of a format of its own as messages in memory: it is written like an MCAP log, and read like one."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pfcli.formats.message_writer import MessageWriter
from pfcli.formats.reader import EVERYTHING, Batch, Channel, Span, Wanted, span_of
from pfcli.formats.schemas import declaration

_PIECE = 1 << 22
"""Bytes of messages in a batch, about."""


class MemoryLog(MessageWriter):
    """Messages in the order in which they are written.

    facts: what `convert` has to say of the log; line: the same as a sentence; places: known landmarks by id.
    """

    def __init__(self, path: Path, files: Sequence[Path] = ()) -> None:
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.losses: list[str] = []
        self.missing = 0
        self.facts: dict[str, Any] = {}
        self.line = ""
        self.places: dict[str, tuple[float, float]] = {}
        self._files = list(files) or [path]
        self._ids: dict[str, int] = {}
        self._data = bytearray()
        self._rows: list[tuple[int, int, int, int, int]] = []
        self._counts: dict[int, int] = {}
        self._done: list[Batch] = []

    @property
    def files(self) -> list[Path]:
        """The files that the log was read from."""
        return self._files

    def raw(self, topic: str, schema: str, stamp_ns: int, payload: bytes) -> None:
        """Append a message."""
        ident = self._ids.get(topic)
        if ident is None:
            ident = self._ids[topic] = len(self._ids)
            encoding, kind, text = declaration(schema)
            self.channels[ident] = Channel(ident, topic, encoding, schema, kind, text)
        count = self._counts.get(ident, 0)
        self._counts[ident] = count + 1
        self._rows.append((ident, stamp_ns, count, len(self._data), len(payload)))
        self._data += payload
        if len(self._data) > _PIECE:
            self._finish()

    def _finish(self) -> None:
        if self._rows:
            channel, stamp, sequence, offset, length = np.array(self._rows, np.int64).T.copy()
            self._done.append(Batch(bytes(self._data), channel, stamp, stamp, sequence, offset, length))
            self._rows, self._data = [], bytearray()

    def survey(self) -> None:
        """All is known."""
        self._finish()

    def span(self) -> Span | None:
        """Times of the messages."""
        return span_of(self.batches())

    def batches(self, wanted: Wanted = EVERYTHING) -> Iterator[Batch]:
        """The messages, some megabytes at a time."""
        self._finish()
        yield from self._done
