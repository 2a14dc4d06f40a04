"""A damaged MCAP log written anew: what the walk finds, in its order, with chunks, index and summary."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from pfcli.errors import LogError, printable
from pfcli.formats import mcap_records
from pfcli.formats.limits import DEFAULTS
from pfcli.formats.log_writer import mcap_writer
from pfcli.formats.mcap_file import McapFile
from pfcli.formats.reader import Channel

_MOST_CHANNELS = 65535


class Repaired(NamedTuple):
    """Counts of what was written: messages, topics, attachments and metadata; of what is missing; where the damage is."""

    messages: int
    topics: int
    extras: int
    missing: int
    losses: list[str]


def repair(
    source: Path, target: Path, compression: str = "zstd", max_chunk_mib: float = DEFAULTS.chunk_mib
) -> Repaired:
    """Copy every message that can be read, untouched. Raises LogError where there is none, OutputError."""
    file = McapFile(source, max_chunk_mib)
    file.survey()
    copied, ids = 0, dict[Channel, int]()
    with mcap_writer(target, compression, file.profile) as out:
        schemas = dict[tuple[str, str, bytes], int]()
        for batch in file.batches():
            columns = zip(*(c.tolist() for c in batch[1:7]), strict=True)
            for channel, log_ns, publish_ns, sequence, offset, length in columns:
                known = file.channels.get(channel)
                if known is None:
                    continue
                if known not in ids:
                    ids[known] = register(out, known, schemas, file.lose)
                payload = bytes(batch.data[offset : offset + length])
                # the fields are unsigned, the walk keeps their bits as signed ones
                out.add_message(ids[known], log_ns % 2**64, payload, publish_ns % 2**64, sequence)
                copied += 1
        if not copied:
            raise LogError(f"{source}: holds no message that can be read; nothing was written")
        topics = len({channel.topic for channel in ids})
        for channel in file.channels.values():
            if channel not in ids:
                ids[channel] = register(out, channel, schemas, file.lose)
        extras = sum(copy_extra(out, opcode, body, file.lose) for opcode, body in file.extras)
    return Repaired(copied, topics, extras, file.missing, file.losses)


def register(
    out: Any, channel: Channel, schemas: dict[tuple[str, str, bytes], int], lose: Callable[[str], None]
) -> int:
    """Declare a channel to a writer; its id there. schemas: those that the writer has. Raises LogError: too many."""
    schema = channel[3:6]
    try:
        metadata = mcap_records.pairs(channel.metadata)
    except (struct.error, UnicodeDecodeError):
        metadata = {}
        lose(f"the metadata of the channel {printable(channel.topic)!r} cannot be read")
    try:
        if schema not in schemas:
            schemas[schema] = out.register_schema(*schema) if any(schema) else 0
        found: int = out.register_channel(channel.topic, channel.encoding, schemas[schema], metadata)
    except struct.error:
        raise LogError(f"topic {printable(channel.topic)!r}: more than 65535 different channels are declared") from None
    if found > _MOST_CHANNELS or len(schemas) > _MOST_CHANNELS:
        raise LogError(
            f"topic {printable(channel.topic)!r}: more than {_MOST_CHANNELS} different channels are declared"
        )
    return found


def copy_extra(out: Any, opcode: int, body: bytes, lose: Callable[[str], None]) -> bool:
    """Whether an attachment or a metadata record could be read and was written."""
    try:
        if opcode == mcap_records.METADATA:
            name, at = mcap_records.string(body, 0)
            out.add_metadata(name, mcap_records.pairs(mcap_records.blob(body, at)[0]))
            return True
        log_ns, create_ns = struct.unpack_from("<QQ", body)
        name, at = mcap_records.string(body, 16)
        media, at = mcap_records.string(body, at)
        (size,) = struct.unpack_from("<Q", body, at)
        (crc,) = struct.unpack_from("<I", body, at + 8 + size)
        if crc and zlib.crc32(body[: at + 8 + size]) != crc:
            lose(f"the attachment {printable(name)!r} fails its checksum; it is kept as it is")
        out.add_attachment(create_ns, log_ns, name, media, body[at + 8 : at + 8 + size])
    except (struct.error, UnicodeDecodeError):
        lose("an attachment or metadata record cannot be read")
        return False
    return True
