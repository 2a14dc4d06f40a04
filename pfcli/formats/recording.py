"""A recording: its parts in the order of time, as one reader.

Parts share their channels, so that what one part says (`/tf_static`, definitions) holds for all. Holes and overlaps between
them are measured.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from pfcli.errors import LogError, printable
from pfcli.formats.containers import open_part
from pfcli.formats.folders import Found, find
from pfcli.formats.limits import AS_IT_IS, Reading
from pfcli.formats.reader import EVERYTHING, Batch, Channel, Reader, Span, Wanted

_SECOND = 1_000_000_000
_HOLE_NS, _USUAL_STEPS = _SECOND, 10
"""Between parts nothing may be recorded for so long, or for so many times the mean time between messages."""
_TOGETHER_NS = 10 * _SECOND
"""Parts with a topic in common that overlap for longer are no parts of one recording."""
_EVERYWHERE = re.compile(r"/(tf|tf_static|rosout(_agg)?|parameter_events|clock|diagnostics)")


class Recording:
    """One recording: a file, its parts, or a folder; a reader itself.

    Raises LogError where the parts do not belong together, or where it is not clear which recording is meant.
    """

    def __init__(self, paths: Sequence[Path], reading: Reading = AS_IT_IS) -> None:
        found = find(paths)
        self.path = found.path
        self.notes: list[str] = []
        """What is worth a word and loses nothing."""
        self._holes = list(found.missing)
        self._parts = self._opened(found.files, reading)
        if len(self._parts) > 1:
            self._put_in_order(found)
        self.channels, self._ids = _together([part.channels for part in self._parts])

    def _opened(self, files: Sequence[Path], reading: Reading) -> list[Reader]:
        """Readers of the parts; what cannot be read of several (a crash leaves an empty last one) is named."""
        parts: list[Reader] = []
        for path in files:
            try:
                part = open_part(path, reading)
                part.survey()
                parts.append(part)
            except LogError as error:
                if path == files[-1] and not parts:
                    raise
                self._holes.append(str(error))
        return parts

    @property
    def files(self) -> list[Path]:
        """The files of all parts, in the order of time."""
        return [file for part in self._parts for file in part.files]

    @property
    def parts(self) -> list[Reader]:
        """The parts, in the order of time."""
        return self._parts

    @property
    def losses(self) -> list[str]:
        """What cannot be read, and what is not there, part by part."""
        return [*self._holes, *(note for part in self._parts for note in part.losses)]

    @property
    def missing(self) -> int:
        """Messages that the parts count and the walk did not find."""
        return sum(part.missing for part in self._parts)

    def survey(self) -> None:
        """Everything is known from the start."""

    def span(self) -> Span | None:
        """From the first message of the first part to the last of the last."""
        spans = [span for span in (part.span() for part in self._parts) if span is not None]
        if not spans:
            return None
        first, last, counts = zip(*spans, strict=True)
        return Span(min(first), max(last), sum(counts))

    def batches(self, wanted: Wanted = EVERYTHING) -> Iterator[Batch]:
        """Messages of the parts; where parts overlap, by the recorder's time."""
        if len(self._parts) == 1:
            yield from self._parts[0].batches(wanted)
            return
        streams = [self._renumbered(k, wanted) for k in range(len(self._parts))]
        at = 0
        while at < len(streams):
            end = at + 1
            while end < len(streams) and self._overlaps[end - 1]:
                end += 1
            yield from _merged(streams[at:end])
            at = end

    def _renumbered(self, k: int, wanted: Wanted) -> Iterator[Batch]:
        """Messages of a part, with the recording's channel ids."""
        ids = self._ids[k]
        if wanted.channels is not None:
            wanted = wanted._replace(channels=frozenset(own for own, new in ids.items() if new in wanted.channels))
            if not wanted.channels:
                return
        table = np.full(max(ids, default=0) + 1, -1, np.int64)
        for own, new in ids.items():
            table[own] = new
        for batch in self._parts[k].batches(wanted):
            known = batch.channel < table.size
            yield batch._replace(channel=np.where(known, table[np.where(known, batch.channel, 0)], -1))

    def _put_in_order(self, found: Found) -> None:
        spans = {id(part): part.span() for part in self._parts}
        if not found.in_order:
            self._parts.sort(key=lambda part: _first(spans[id(part)]))
        filled = [(part, span) for part in self._parts if (span := spans[id(part)]) is not None]
        self._overlaps = [False] * (len(self._parts) - 1)
        for (part, span), (after, later) in pairwise(filled):
            gap, usual = later.first_ns - span.last_ns, (span.last_ns - span.first_ns) // max(1, span.messages - 1)
            if gap > max(_HOLE_NS, _USUAL_STEPS * usual):
                self._holes.append(f"{after.path}: begins {gap / _SECOND:.3f} s after {part.path.name} ends")
            mine, theirs = _topics(part), _topics(after)
            common = sorted(mine & theirs)
            if gap >= 0 and mine and theirs and not common:
                raise LogError(
                    f"{after.path}: has no topic in common with {part.path}: they are no parts of one recording"
                )
            if gap < -_TOGETHER_NS and common:
                raise LogError(
                    f"{after.path}: overlaps {part.path} by {-gap / _SECOND:.1f} s, and both hold {printable(common[0])}:"
                    " they are no parts of one recording; give one of them"
                )
            if gap < 0:
                self._overlaps[self._parts.index(after) - 1] = True
                self.notes.append(f"{after.path}: overlaps {part.path.name} by {-gap / _SECOND:.3f} s")


def _first(span: Span | None) -> int:
    return span.first_ns if span is not None else 0


def _topics(part: Reader) -> set[str]:
    """Topics that tell one robot's recording from another's."""
    return {c.topic for c in part.channels.values() if not _EVERYWHERE.fullmatch(c.topic)}


def _together(tables: Sequence[dict[int, Channel]]) -> tuple[dict[int, Channel], list[dict[int, int]]]:
    """Channels of all parts, and for each part its ids -> theirs. Channels of two parts that say the same are one."""
    if len(tables) == 1:
        return tables[0], [{ident: ident for ident in tables[0]}]
    channels: dict[int, Channel] = {}
    known: dict[tuple[object, ...], int] = {}
    ids: list[dict[int, int]] = []
    for table in tables:
        times: dict[tuple[object, ...], int] = {}
        mine: dict[int, int] = {}
        for own, channel in table.items():
            kind = channel[1:6]
            times[kind] = times.get(kind, 0) + 1
            new = known.setdefault((*kind, times[kind]), len(known))
            channels.setdefault(new, channel._replace(id=new))
            mine[own] = new
        ids.append(mine)
    return channels, ids


def _merged(streams: Iterable[Iterator[Batch]]) -> Iterator[Batch]:
    """Batches of streams that overlap, cut so that they follow each other in the recorder's time."""
    heads = [(batch, stream) for stream in streams if (batch := next(stream, None)) is not None]
    while len(heads) > 1:
        heads.sort(key=lambda head: int(head[0].log_ns[0]))
        (batch, stream), limit = heads[0], int(heads[1][0].log_ns[0])
        later = batch.log_ns > limit
        count = int(later.argmax()) if later.any() else len(later)
        count = max(1, count)
        yield batch.rows(slice(0, count))
        rest = batch.rows(slice(count, None)) if count < len(later) else next(stream, None)
        heads[:1] = [(rest, stream)] if rest is not None else []
    for batch, stream in heads:
        yield batch
        yield from stream
