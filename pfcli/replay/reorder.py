"""The reorder buffer: messages of several topics in one total order, in bounded memory.

The order is (stamp, rank of the topic's role, place in the file). A message waits until nothing earlier can come any more;
what comes later still is counted, and so is what has no usable stamp.
"""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import kernel
from pfcli.dropped import Dropped
from pfcli.errors import LogError
from pfcli.formats.messages import SECOND, Decoder, stamp_in_header
from pfcli.formats.reader import Batch, Channel
from pfcli.formats.roles import RANK

_LEAP_NS = SECOND
"""A stamp further ahead than this and than the horizon, behind which one of the next messages goes back, is no time."""
_BEYOND = 2
"""After so many batches behind the end of the window the rest of the log is not read."""
_WITNESSES = 5
"""A leap is believed that so many messages follow."""
_PAUSE_NS = 3600 * SECOND
_NEVER, _LONG_AGO = (1 << 63) - 1, -(1 << 61)
_STAMPS_END = 1 << 62
"""Stamps from here on (the year 2116) are no times: sums of them would overflow."""
_UNUSABLE, _NOT_OURS = -1, -2

Stamp = Callable[[bytes], int | None]
"""Payload -> stamp (ns); None: holds nothing for this source. Raises ValueError."""


Heard = Callable[[str, str, NDArray[np.int64], NDArray[np.int64]], None]
"""Told of every wanted message before it is put in order: role, place for notes, log times (n,) and stamps (n,), ns; negative
where a message has no usable stamp."""


class Source(NamedTuple):
    """A channel that plays a role: how it is decoded, how it is stamped (None: by its ROS header), what notes call it."""

    role: str
    channel: Channel
    decode: Decoder
    stamp: Stamp | None
    where: str


class Waiting(NamedTuple):
    """How long (ns) and how much (bytes of messages) may wait; the clock that counts, and offsets of roles (ns)."""

    horizon_ns: int
    room_bytes: int
    clock: str
    offsets_ns: dict[str, int]


Message = tuple[Source, Any, int, int, int]
"""Source, buffer, offset and length of the payload in it, stamp (ns)."""


@kernel
def _header_stamps(data, offset, length, out):
    """Stamps (ns) of ROS headers; -1 where the payload is too short or not little endian."""
    for k in range(offset.size):
        at = offset[k]
        if length[k] < 12 or data[at + 1] & 1 == 0:
            out[k] = -1
            continue
        sec = np.int64(0)
        nsec = np.int64(0)
        for j in range(4):
            sec |= np.int64(data[at + 4 + j]) << (8 * j)
            nsec |= np.int64(data[at + 8 + j]) << (8 * j)
        if sec >= 1 << 31:
            sec -= 1 << 32
        out[k] = sec * 1_000_000_000 + nsec if sec >= 0 and nsec < 1_000_000_000 else -1


class Reorder:
    """Puts the messages of `sources` into order; `window`: seconds after the first stamp, None: open."""

    def __init__(
        self,
        path: Path,
        sources: list[Source],
        waiting: Waiting,
        window: tuple[float | None, float | None],
        dropped: Dropped,
        heard: Heard | None = None,
    ) -> None:
        self._path, self._sources, self._waiting, self._loss = path, sources, waiting, dropped
        self._start_s, self._end_s = window
        self._heard = heard
        self._buffers: dict[int, bytes | memoryview] = {}
        self._rows = np.empty((0, 7), np.int64)
        """stamp, rank, place in the file, index of the source, key of the buffer, offset, length"""
        self._undecided, self._sure = self._rows, True
        self._leap = max(waiting.horizon_ns, _LEAP_NS)
        self._count = 0
        self._latest = _LONG_AGO
        self._first: int | None = None

    @property
    def first_ns(self) -> int:
        """The first stamp (ns), known as soon as there is a message."""
        return self._first or 0

    def messages(self, batches: Iterable[Batch]) -> Iterator[Message]:
        """The wanted messages in their order. Raises LogError where more lies at one stamp than there is room for."""
        beyond = 0
        for batch in batches:
            self._take(batch)
            yield from self._release(self._latest - self._waiting.horizon_ns)
            beyond = beyond + 1 if self._is_over() else 0
            if beyond == _BEYOND:
                return
        # nothing follows that could speak against the last messages: a cut log ends with them, however far it came
        self._rows = np.concatenate([self._rows, self._in_time(self._undecided, last=True)])
        yield from self._release(_NEVER)

    def _is_over(self) -> bool:
        """Whether whatever comes now, and comes in time, lies behind the end of the window."""
        if self._end_s is None or self._first is None:
            return False
        return self._latest - self._waiting.horizon_ns > self._first + int(self._end_s * SECOND)

    def _take(self, batch: Batch) -> None:
        """Stamp the wanted messages of a batch and put them into the buffer."""
        key = len(self._buffers) and max(self._buffers) + 1
        parts = []
        for index, source in enumerate(self._sources):
            picked = np.flatnonzero(batch.channel == source.channel.id)
            if picked.size == 0:
                continue
            rows = np.empty((picked.size, 7), np.int64)
            rows[:, 0] = self.stamps(source, batch, picked)
            if self._heard is not None:
                self._heard(source.role, source.where, batch.log_ns[picked], rows[:, 0].copy())
            rows[:, 1] = RANK[source.role]
            rows[:, 2] = picked + self._count
            rows[:, 3], rows[:, 4] = index, key
            rows[:, 5], rows[:, 6] = batch.offset[picked], batch.length[picked]
            parts.append(rows[rows[:, 0] != _NOT_OURS])
        self._count += batch.channel.size
        if not parts:
            return
        self._buffers[key] = batch.data
        rows = np.concatenate(parts)
        rows = rows[np.argsort(rows[:, 2])]
        waiting, self._sure = self._not_after(rows), batch.sure
        if not batch.sure:
            self._undecided, rows = rows, rows[:0]
        rows = np.concatenate([waiting, rows])
        self._rows = np.concatenate([self._rows, self._in_time(rows)])
        if sum(map(len, self._buffers.values())) > self._waiting.room_bytes:
            raise LogError(
                f"{self._path}: more than {self._waiting.room_bytes / 2**20:g} MiB of messages lie within"
                f" {self._waiting.horizon_ns / SECOND:g} s of one stamp; --time log takes the recorder's clock,"
                " --max-buffer-mib makes room"
            )

    def stamps(self, source: Source, batch: Batch, picked: NDArray[np.int64]) -> NDArray[np.int64]:
        """Stamps with their offset (ns); negative where there is none."""
        clock, out = self._waiting.clock, np.empty(picked.size, np.int64)
        if clock != "header":
            out = (batch.publish_ns if clock == "publish" else batch.log_ns)[picked]
        elif source.stamp is None and stamp_in_header(source.channel.schema_name):
            _header_stamps(np.frombuffer(batch.data, np.uint8), batch.offset[picked], batch.length[picked], out)
        elif source.stamp is None:
            out = batch.log_ns[picked]
        else:
            for k, (at, size) in enumerate(zip(batch.offset[picked], batch.length[picked], strict=True)):
                try:
                    stamp = source.stamp(bytes(batch.data[at : at + size]))
                except ValueError:
                    stamp = _UNUSABLE
                out[k] = _NOT_OURS if stamp is None else stamp
        good = (out >= 0) & (out < _STAMPS_END)
        out[~good & (out != _NOT_OURS)] = _UNUSABLE
        out[good] = np.maximum(out[good] + self._waiting.offsets_ns.get(source.role, 0), _UNUSABLE)
        return out

    def _in_time(self, rows: NDArray[np.int64], *, last: bool = False) -> NDArray[np.int64]:
        """Rows in file order without those that have no usable stamp or come later than the horizon can mend.

        What is late is decided by the order in the file alone, whatever the chunks.
        """
        unusable = rows[:, 0] == _UNUSABLE
        self._skip(rows[unusable])
        rows = self._without_leaps(rows[~unusable], last=last)
        if rows.size == 0:
            return rows
        newest = np.maximum.accumulate(np.maximum(rows[:, 0], self._latest))
        behind = newest - rows[:, 0]
        self._latest = int(newest[-1])
        for k in np.flatnonzero(behind > self._waiting.horizon_ns).tolist():
            self._loss.add(
                "late",
                f"{self._sources[rows[k, 3]].where}: time goes back by {behind[k] / SECOND:.3f} s; a larger --reorder mends"
                " it, or --time log",
            )
        return rows[behind <= self._waiting.horizon_ns]

    def _not_after(self, following: NDArray[np.int64]) -> NDArray[np.int64]:
        """The rows that wait for a word on them, without those that leap ahead of the rows that follow."""
        waiting, self._undecided = self._undecided, self._undecided[:0]
        usable = following[following[:, 0] != _UNUSABLE, 0][:3]
        if self._sure or not len(waiting) or not len(usable):
            return waiting
        ahead = waiting[:, 0] - int(np.median(usable)) > self._leap
        self._leave_out(waiting[ahead])
        kept: NDArray[np.int64] = waiting[~ahead]
        return kept

    def _without_leaps(self, rows: NDArray[np.int64], *, last: bool) -> NDArray[np.int64]:
        """Rows in file order without stamps that leap ahead: a flipped bit must not make all that follows late.

        A clock that is set is followed by the next messages. Where the last rows leap, the next batch tells.
        """
        before = np.maximum.accumulate(np.concatenate([[self._latest], rows[:, 0]]))[:-1]
        if not (rows[:, 0] - before > self._leap).any():
            return rows
        stamps, latest, lone = rows[:, 0].tolist(), self._latest, np.zeros(len(rows), np.bool_)
        for k, stamp in enumerate(stamps):
            if stamp - latest > self._leap:
                after = stamps[k + 1 : k + 1 + _WITNESSES]
                if len(after) < _WITNESSES and not last:
                    self._undecided, rows, lone = rows[k:], rows[:k], lone[:k]
                    break
                lone[k] = any(stamp - other > self._leap for other in after)
                if not after:  # nobody can tell: a pause before the last message, or no time at all
                    lone[k] = latest != _LONG_AGO and stamp - latest > _PAUSE_NS
            if not lone[k]:
                latest = max(latest, stamp)
        self._leave_out(rows[lone])
        return rows[~lone]

    def _skip(self, rows: NDArray[np.int64]) -> None:
        for index in rows[:, 3].tolist():
            where = self._sources[index].where
            self._loss.add("bad stamp", f"{where}, field 'stamp': not a usable time; such messages are skipped")

    def _leave_out(self, rows: NDArray[np.int64]) -> None:
        for index in rows[:, 3].tolist():
            self._loss.add(
                "leap of time",
                f"{self._sources[index].where}: a message is more than {self._leap / SECOND:g} s ahead of what follows and is"
                " skipped; a larger --reorder keeps it, or --time log",
            )

    def _release(self, until: int) -> Iterator[Message]:
        """Emit what is older than `until`."""
        ready = self._rows[:, 0] < until
        if not ready.any():
            return
        rows, self._rows = self._rows[ready], self._rows[~ready]
        rows = rows[np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))]
        if self._first is None:
            self._first = int(rows[0, 0])
        low = self._first + int((self._start_s or 0.0) * SECOND)
        high = self._first + int(self._end_s * SECOND) if self._end_s is not None else _NEVER
        rows = rows[(rows[:, 0] >= low) & (rows[:, 0] <= high)]
        for stamp, _, _, index, key, offset, length in rows.tolist():
            yield self._sources[index], self._buffers[key], offset, length, stamp
        alive = {*self._rows[:, 4].tolist(), *self._undecided[:, 4].tolist()}
        self._buffers = {key: data for key, data in self._buffers.items() if key in alive}
