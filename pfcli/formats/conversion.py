"""Any recording as one MCAP log: what its reader gives, written. Nothing is left out; types that pfcli does not read stay as
they are."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pfcli.errors import LogError
from pfcli.formats.canonical import Canonical
from pfcli.formats.limits import Reading
from pfcli.formats.log_writer import mcap_writer
from pfcli.formats.mcap_file import McapFile
from pfcli.formats.mcap_repair import copy_extra, register
from pfcli.formats.memory_log import MemoryLog
from pfcli.formats.reader import Channel
from pfcli.formats.recording import Recording
from pfcli.formats.schemas import is_known


class Converted(NamedTuple):
    """messages: count; unknown: type that pfcli does not read -> messages, which were copied; extras: attachments and
    metadata; facts, line: what a log of text has to say; places: its landmarks; losses: what could not be read; notes:
    what else is worth a word."""

    messages: int
    unknown: dict[str, int]
    extras: int
    facts: dict[str, Any]
    line: str
    places: dict[str, tuple[float, float]]
    losses: list[str]
    notes: list[str]


def convert(sources: Sequence[Path], target: Path, compression: str, reading: Reading) -> Converted:
    """Write the recording. Raises LogError where it holds no message, OutputError; then nothing is left of `target`."""
    recording = Recording(sources, reading)
    reader = Canonical(recording, reading.max_chunk_mib)
    told: list[str] = []
    with mcap_writer(target, compression) as out:
        counts = _copied(out, reader, told)
        if not counts:
            why = f" ({reader.losses[0]})" if reader.losses else ""
            raise LogError(f"{recording.path}: holds no message that can be read{why}; nothing was written")
        extras = 0
        for part in recording.parts:
            if isinstance(part, McapFile):
                extras += sum(copy_extra(out, opcode, body, part.lose) for opcode, body in part.extras)
    unknown = Counter[str]()
    for ident, count in counts.items():
        name = reader.channels[ident].schema_name
        if not is_known(name):
            unknown[name or "no type"] += count
    texts = [part for part in recording.parts if isinstance(part, MemoryLog)]
    return Converted(
        messages=counts.total(),
        unknown=dict(unknown),
        extras=extras,
        facts=texts[0].facts if len(texts) == 1 else {},
        line=texts[0].line if len(texts) == 1 else "",
        places={name: place for text in texts for name, place in text.places.items()},
        losses=[*reader.losses, *told],
        notes=recording.notes,
    )


def _copied(out: Any, reader: Canonical, told: list[str]) -> Counter[int]:
    """Write all messages; how many of each channel there were."""
    ids, schemas, counts = dict[Channel, int](), dict[tuple[str, str, bytes], int](), Counter[int]()
    for batch in reader.batches():
        columns = zip(*(c.tolist() for c in batch[1:7]), strict=True)
        for ident, log_ns, publish_ns, sequence, offset, length in columns:
            channel = reader.channels.get(ident)
            if channel is None:
                continue
            if channel not in ids:
                ids[channel] = register(out, channel, schemas, told.append)
            payload = bytes(batch.data[offset : offset + length])
            out.add_message(ids[channel], log_ns % 2**64, payload, publish_ns % 2**64, sequence % 2**32)
            counts[ident] += 1
    return counts
