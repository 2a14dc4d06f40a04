"""A reader whose messages are all laid out as pfcli reads them, whatever the recorder wrote.

What is translated: messages that are compressed one by one (rosbag2's compression mode `message`), other definitions of
known types, ROS 1 serialisation, Foxglove's schemas. Messages that are as they should be are not touched.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pfcli.errors import printable
from pfcli.formats import carried_types, foxglove
from pfcli.formats.carried_types import Translate
from pfcli.formats.reader import EVERYTHING, Batch, Channel, Reader, Span, Wanted

_ZSTD = b"\x28\xb5\x2f\xfd"


class Canonical:
    """A reader of any container as one of canonical messages."""

    def __init__(self, inner: Reader, max_message_mib: float) -> None:
        self.inner = inner
        self.path: Path = inner.path
        self.channels: dict[int, Channel] = {}
        self._limit = int(max_message_mib * 2**20)
        self._translate: dict[int, Translate] = {}
        self._spoilt: Counter[tuple[str, str]] = Counter()
        for ident, channel in inner.channels.items():
            found, translate = (
                foxglove.canonical(channel) if foxglove.is_one(channel) else carried_types.canonical(channel)
            )
            self.channels[ident] = found
            if translate is not None:
                self._translate[ident] = translate

    @property
    def files(self) -> list[Path]:
        """The files that it reads."""
        return self.inner.files

    @property
    def losses(self) -> list[str]:
        """What the last walk could not read or translate."""
        return [*self.inner.losses, *(self._sentence(*key) for key in self._spoilt)]

    @property
    def missing(self) -> int:
        """Messages that the container counts and the walk did not find."""
        return self.inner.missing

    def _sentence(self, topic: str, why: str) -> str:
        count = self._spoilt[topic, why]
        return f"{self.path}: topic {printable(topic)!r}: {count} messages cannot be translated: {why}"

    def survey(self) -> None:
        """All is known."""

    def span(self) -> Span | None:
        """As the container says."""
        return self.inner.span()

    def batches(self, wanted: Wanted = EVERYTHING) -> Iterator[Batch]:
        """Messages in the order of the file, as pfcli reads them."""
        self._spoilt.clear()
        foreign = frozenset(self._translate) & (
            wanted.channels if wanted.channels is not None else frozenset(self._translate)
        )
        for batch in self.inner.batches(wanted):
            if len(batch.channel) and (self._is_packed(batch) or self._has(batch, foreign)):
                yield self._translated(batch, wanted)
            else:
                yield batch

    def _has(self, batch: Batch, channels: frozenset[int]) -> bool:
        return bool(channels) and bool(np.isin(batch.channel, list(channels)).any())

    def _is_packed(self, batch: Batch) -> bool:
        """Whether a message begins like zstd does; no other encoding here begins so."""
        first = np.frombuffer(batch.data, np.uint8)
        filled = batch.length >= len(_ZSTD)
        return bool((first[batch.offset[filled]] == _ZSTD[0]).any())

    def _translated(self, batch: Batch, wanted: Wanted) -> Batch:
        """The wanted messages of a batch in a buffer of their own; those that cannot be translated are left out."""
        kept, payloads = [], []
        columns = zip(batch.channel.tolist(), batch.offset.tolist(), batch.length.tolist(), strict=True)
        for k, (ident, offset, length) in enumerate(columns):
            channel = self.channels.get(ident)
            if channel is None or (wanted.channels is not None and ident not in wanted.channels):
                continue
            payload = bytes(batch.data[offset : offset + length])
            try:
                if payload[:4] == _ZSTD:
                    payload = self._unpacked(payload)
                translate = self._translate.get(ident)
                payloads.append(payload if translate is None else translate(payload))
                kept.append(k)
            except ValueError as error:
                self._spoilt[channel.topic, str(error)] += 1
        length_ = np.array([len(p) for p in payloads], np.int64)
        offset_ = np.cumsum(length_) - length_
        chosen = batch.rows(np.array(kept, np.int64))
        return chosen._replace(data=b"".join(payloads), offset=offset_, length=length_)

    def _unpacked(self, payload: bytes) -> bytes:
        import zstandard

        try:
            return zstandard.ZstdDecompressor().decompressobj().decompress(payload)[: self._limit]
        except zstandard.ZstdError:
            raise ValueError("is compressed, and cannot be decompressed") from None
