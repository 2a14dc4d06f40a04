"""The records inside a chunk of an MCAP file, whatever is left of it.

A chunk says how large it is and how it is compressed; none of that is believed. The decompressors are stopped at a limit,
and where the header is damaged the magic number of the compressed frame says what it is.
"""

import struct
import zlib
from typing import Any, NamedTuple

from pfcli.errors import printable

_MAGIC = {b"\x28\xb5\x2f\xfd": "zstd", b"\x04\x22\x4d\x18": "lz4"}
_PIECE = 1024


class Chunk(NamedTuple):
    """The records of a chunk, as far as they could be had, and what is wrong with them ('': nothing)."""

    records: bytes | memoryview
    trouble: str = ""


def open_chunk(record: memoryview, limit: int) -> Chunk:
    """Decompress the body of a chunk record; `limit`: bytes of records that a chunk may hold."""
    size, crc, length = struct.unpack_from("<QII", record, 16)
    name = bytes(record[32 : 32 + length]).decode("ascii", "replace")
    if name not in ("", "zstd", "lz4"):
        return salvage(record, limit) or Chunk(
            b"", f"is compressed with {printable(name)!r}, which is none of zstd, lz4"
        )
    (stored,) = struct.unpack_from("<Q", record, 32 + length)
    records, trouble = _decompressed(name, record[40 + length : 40 + length + stored], size, limit)
    if not trouble and len(records) != size:
        trouble = f"holds {len(records)} bytes and claims {size}"
    if not trouble and crc and zlib.crc32(records) != crc:
        trouble = "fails its checksum; its messages are used as far as they can be"
    return Chunk(records, trouble)


def salvage(record: memoryview, limit: int) -> Chunk | None:
    """What was a compressed chunk before its header was damaged or its end cut off; None where nothing tells."""
    for at in (44, 43):  # where the frame begins behind the names "zstd" and "lz4"
        name = _MAGIC.get(bytes(record[at : at + 4]))
        if name:
            return Chunk(_decompressed(name, record[at:], 0, limit)[0], "is damaged or cut off")
    return None


def _decompressed(name: str, body: memoryview, size: int, limit: int) -> tuple[bytes | memoryview, str]:
    if name == "":
        return body, ""
    if name == "zstd":
        import zstandard

        if 0 < size <= limit and _frame_size(body) == size:
            try:
                return zstandard.ZstdDecompressor().decompress(body, max_output_size=size), ""
            except zstandard.ZstdError:
                pass
        try:
            return _piecewise(_zstd_stream(body), zstandard.ZstdError, limit)
        except MemoryError:
            return b"", "asks for more memory than there is"
    import lz4.frame

    if 0 < size <= limit:
        try:
            whole = lz4.frame.LZ4FrameDecompressor().decompress(body, max_length=size)
            if len(whole) == size:
                return whole, ""
        except (RuntimeError, EOFError):
            pass
    return _piecewise(_lz4_stream(body), (RuntimeError, EOFError), limit)


def _frame_size(body: memoryview) -> int:
    """What a zstd frame says that it holds; -1: unknown."""
    import zstandard

    try:
        return zstandard.frame_content_size(bytes(body[:18]))
    except zstandard.ZstdError:
        return -1


def _zstd_stream(body: memoryview) -> Any:
    import zstandard

    with zstandard.ZstdDecompressor().stream_reader(body, read_size=_PIECE) as stream:
        while piece := stream.read(_PIECE * 64):
            yield piece


def _lz4_stream(body: memoryview) -> Any:
    import lz4.frame

    stream = lz4.frame.LZ4FrameDecompressor()
    for start in range(0, len(body), _PIECE):
        yield stream.decompress(bytes(body[start : start + _PIECE]))
        if stream.eof:
            return


def _piecewise(stream: Any, errors: Any, limit: int) -> tuple[bytes, str]:
    """What a stream gives up to its damage, its end or the limit."""
    pieces: list[bytes] = []
    size, trouble = 0, ""
    try:
        for piece in stream:
            pieces.append(piece)
            size += len(piece)
            if size > limit:
                return b"", f"holds more than {limit / 2**20:g} MiB; --max-chunk-mib reads larger ones"
    except errors:
        trouble = "cannot be decompressed whole"
    return b"".join(pieces), trouble
