"""The records of MCAP data, found by a kernel: also past damage, where the next sane record begins.

Nothing is decoded here but what tells whether a record is sane. Source: the MCAP specification, version 0.
"""

import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import inline_kernel, kernel

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, CHUNK = 0x01, 0x02, 0x03, 0x04, 0x06
MESSAGE_INDEX, CHUNK_INDEX = 0x07, 0x08
ATTACHMENT, STATISTICS, METADATA, DATA_END = 0x09, 0x0B, 0x0C, 0x0F
_PADDING = 64
"""Records may be longer than their fields, for fields of the future; by more than this they are taken for damage."""
_BATCH = 8192


class Records(NamedTuple):
    """What a piece of data holds, in its order.

    messages: int64 (n, 6): channel, sequence, log and publish time (ns), offset and length of the payload;
    others: int64 (m, 3): opcode, offset and length of the body; gaps: int64 (g, 2): damaged bytes [from, to).
    """

    messages: NDArray[np.int64]
    others: NDArray[np.int64]
    gaps: NDArray[np.int64]


@inline_kernel
def _number(buffer, at, width):
    """Little-endian integer; negative where 64 bits overflow."""
    value = np.int64(0)
    for k in range(width):
        value |= np.int64(buffer[at + k]) << (8 * k)
    return value


@inline_kernel
def _holds(length, needed):
    """Whether a record of this length holds exactly these fields, or these and a padding."""
    return 0 <= needed <= length <= needed + _PADDING


@kernel
def _strings(buffer, at, end, count):
    """Position after `count` strings (or blobs) with 4-byte lengths; -1 where they run past the end."""
    for _ in range(count):
        if at + 4 > end:
            return -1
        at += 4 + _number(buffer, at, 4)
        if at > end:
            return -1
    return at


@kernel
def _extent(buffer, at, known, declared):
    """Length of the body of the record at `at`; -1 where no sane record begins there.

    Messages are of a channel that is known, or of the one that was just declared (no literal: it would compile twice).
    """
    rest = buffer.size - at - 9
    if rest < 0:
        return -1
    opcode, length, body = buffer[at], _number(buffer, at + 1, 8), at + 9
    if length < 0 or length > rest:
        return -1
    sane = opcode >= 0x80  # private records can hold anything
    if opcode == 0x05:
        channel = _number(buffer, body, 2) if length >= 22 else -2
        sane = channel >= 0 and (known[channel] or channel == declared)
    elif opcode == 0x06 and length >= 40:
        name = _number(buffer, body + 28, 4)
        sane = name <= 16 and length >= 40 + name and _holds(length, 40 + name + _number(buffer, body + 32 + name, 8))
    elif opcode == 0x07 and length >= 6:
        sane = _holds(length, 6 + _number(buffer, body + 2, 4))
    elif opcode == 0x0F:
        sane = _holds(length, 4)
    elif opcode == 0x02:
        sane = _holds(length, 20)
    elif opcode == 0x01:
        sane = _holds(length, _strings(buffer, body, body + length, 2) - body)
    elif opcode == 0x03 and length >= 2:
        sane = _holds(length, _strings(buffer, body + 2, body + length, 3) - body)
    elif opcode == 0x04 and length >= 4:
        sane = _holds(length, _strings(buffer, body + 4, body + length, 3) - body)
    elif opcode == 0x09 and length >= 16:
        after = _strings(buffer, body + 16, body + length, 2) - body
        sane = 0 <= after <= length - 12 and _holds(length, after + 12 + _number(buffer, body + after, 8))
    elif opcode == 0x0C:
        sane = _holds(length, _strings(buffer, body, body + length, 2) - body)
    elif opcode == 0x08:
        sane = length >= 68
    elif opcode == 0x0A:
        sane = length >= 48
    elif opcode == 0x0B:
        sane = length >= 46
    elif opcode == 0x0D:
        sane = length >= 12
    elif opcode == 0x0E:
        sane = _holds(length, 17)
    return length if sane else -1


@kernel
def _next(buffer, at, known):
    """Where, from `at` on, the next sane record begins that two more follow (or the end); the size where none does.

    A chunk with the name of a compression vouches for itself.
    """
    for start in range(at, buffer.size - 8):
        if buffer[start] == 0 or buffer[start] > 0x0F or buffer[start + 8] != 0:
            continue
        position, links, declared = start, 0, np.int64(-1)
        while links < 3:
            length = _extent(buffer, position, known, declared)
            if length < 0:
                break
            if buffer[position] == 0x04:
                declared = _number(buffer, position + 9, 2)
            named = buffer[position] == 0x06 and 3 <= _number(buffer, position + 37, 4) <= 4
            position, links = position + 9 + length, links + 1
            if named or position == buffer.size or buffer[position - 9 - length] == 0x02:
                links = 3
        if links == 3:
            return start
    return buffer.size


@kernel
def _index(buffer, start, messages, others, gaps, known):
    """Fill the tables of `Records` from `start` until the end of the data section or until one of them is full.

    known: bool (65536,): channels that were declared; grows with what is met. A message cannot tell whether its own
    length is right: where nothing sane follows it, the search begins inside it.
    Returns (next position, messages, others, gaps, whether there may be more).
    """
    position, count, rest, holes, doubt = start, 0, 0, 0, start
    while position < buffer.size:
        if count == messages.shape[0] or rest == others.shape[0] or holes == gaps.shape[0]:
            return position, count, rest, holes, True
        length = _extent(buffer, position, known, np.int64(-1))
        if length < 0:
            found = _next(buffer, doubt, known)
            gaps[holes, 0], gaps[holes, 1] = (position if position < found else doubt), found
            holes += 1
            position, doubt = found, found + 1
            continue
        opcode, body = buffer[position], position + 9
        if opcode == 0x05:
            messages[count, 0] = _number(buffer, body, 2)
            messages[count, 1] = _number(buffer, body + 2, 4)
            messages[count, 2] = _number(buffer, body + 6, 8)
            messages[count, 3] = _number(buffer, body + 14, 8)
            messages[count, 4] = body + 22
            messages[count, 5] = length - 22
            count += 1
            doubt = body + 22
        else:
            others[rest, 0], others[rest, 1], others[rest, 2] = opcode, body, length
            rest += 1
            doubt = body + length if opcode < 0x80 else body
            if opcode == 0x04:
                known[_number(buffer, body, 2)] = True
        position = body + length
        if opcode == 0x0F or opcode == 0x02:
            return position, count, rest, holes, False
    return position, count, rest, holes, False


class Walk:
    """Goes through `data`, uint8 (size,), from `position` on, some thousand records at a time."""

    def __init__(self, data: NDArray[np.uint8], known: NDArray[np.bool_], position: int = 0) -> None:
        self.position = position
        self.more = True
        self._data, self._known = data, known

    def step(self) -> Records:
        """The next records; their offsets count from the beginning of the data."""
        messages = np.empty((_BATCH, 6), np.int64)
        others, gaps = np.empty((_BATCH, 3), np.int64), np.empty((64, 2), np.int64)
        self.position, n, m, g, self.more = _index(self._data, self.position, messages, others, gaps, self._known)
        return Records(messages[:n], others[:m], gaps[:g])


def string(body: bytes, at: int) -> tuple[str, int]:
    """The string at `at` and the position after it. Raises struct.error or UnicodeDecodeError."""
    data, after = blob(body, at)
    return data.decode(), after


def pairs(data: bytes) -> dict[str, str]:
    """A map of strings as records keep it. Raises struct.error or UnicodeDecodeError."""
    at, found = 0, {}
    while at < len(data):
        key, at = string(data, at)
        found[key], at = string(data, at)
    return found


def blob(body: bytes, at: int) -> tuple[bytes, int]:
    """The bytes at `at`, whose length is in front of them, and the position after them. Raises struct.error."""
    (length,) = struct.unpack_from("<I", body, at)
    if at + 4 + length > len(body):
        raise struct.error
    return body[at + 4 : at + 4 + length], at + 4 + length
