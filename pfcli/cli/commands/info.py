"""`pfcli info LOG...`."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pfcli import registry
from pfcli.cli.types import Readable, max_chunk_option

if TYPE_CHECKING:
    from pfcli.formats.reader import Reader


@click.command()
@click.argument("logs", nargs=-1, required=True, type=Readable())
@max_chunk_option
@click.option("--json", "as_json", is_flag=True, help="One JSON object per log.")
@click.option(
    "--check", "look", is_flag=True, help="Say what is wrong with each log instead: `pfcli check` with no option."
)
def info(logs: tuple[Path, ...], max_chunk_mib: float, as_json: bool, look: bool) -> int:
    """What each LOG holds: topics, types, counts, rates, gaps, span, and which systems can run on it. `-`: standard input.

    Example: pfcli info --json *.mcap | jq -r '.log + " " + (.span_s | tostring)'
    """
    from pfcli.cli.printing import emit, lost

    code = 0
    if look:
        from pfcli.cli.commands.check import checked
        from pfcli.formats.limits import Limits
        from pfcli.replay.settings import Settings

        settings = Settings(limits=Limits(chunk_mib=max_chunk_mib))
        given = {"deep": False, "ignore": (), "strict": False, "as_json": as_json}
        return max(checked([path], settings, given) for path in logs)
    for path in logs:
        found, notes = _describe(path, max_chunk_mib)
        emit(found, list(_lines(found)), as_json)
        code = max(code, lost({"damage": len(notes)} if notes else {}, notes))
    return code


def _describe(path: Path, max_chunk_mib: float) -> tuple[dict[str, Any], list[str]]:
    import numpy as np

    from pfcli.errors import printable
    from pfcli.formats.canonical import Canonical
    from pfcli.formats.limits import Reading
    from pfcli.formats.recording import Recording

    file = Recording([path], Reading(max_chunk_mib))
    times: dict[int, list[Any]] = {}
    for batch in file.batches():
        for channel in np.unique(batch.channel).tolist():
            times.setdefault(channel, []).append(batch.log_ns[batch.channel == channel])
    topics = []
    span: list[int] = []
    for ident, channel in Canonical(file, max_chunk_mib).channels.items():
        stamps = np.concatenate(times.get(ident, [np.empty(0, np.int64)]))
        row: dict[str, Any] = {
            "topic": printable(channel.topic),
            "type": printable(channel.schema_name),
            "encoding": printable(channel.encoding),
            "messages": int(stamps.size),
        }
        if stamps.size:
            span += [int(stamps.min()), int(stamps.max())]
        if stamps.size > 1:
            steps = np.diff(stamps)
            seconds = (stamps.max() - stamps.min()) * 1e-9
            row["rate_hz"] = round((stamps.size - 1) / seconds, 3) if seconds > 0 else 0.0
            row["longest_gap_s"] = round(float(steps.max()) * 1e-9, 3)
            row["backward_steps"] = int((steps < 0).sum())
        topics.append(row)
    found = {
        "log": str(path),
        "bytes": sum(part.stat().st_size for part in file.files),
        "messages": sum(t["messages"] for t in topics),
        "span_s": round((max(span) - min(span)) * 1e-9, 3) if span else 0.0,
        "start_ns": min(span, default=0),
        "topics": topics,
        "systems": _systems(topics),
        "damage": file.losses,
        "notes": file.notes,
        "frames": _frames(path, max_chunk_mib),
        "parts": [_part(part) for part in file.parts] if len(file.parts) > 1 else [],
    }
    return found, file.losses


def _frames(path: Path, max_chunk_mib: float) -> str:
    """The transforms that the recording has, as a tree; '' where they cannot be told."""
    from pfcli.errors import PfcliError
    from pfcli.formats.limits import Limits
    from pfcli.replay.log import Log
    from pfcli.replay.settings import Settings

    try:
        found = Log(path, Settings(limits=Limits(chunk_mib=max_chunk_mib))).frames.tree.text()
    except PfcliError:
        return ""
    return "" if found == "none" else found


def _date(stamp_ns: int) -> str:
    """A recorder's time as a date."""
    from datetime import UTC, datetime

    return datetime.fromtimestamp(stamp_ns // 1_000_000_000, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _part(part: "Reader") -> dict[str, Any]:
    """A part of a recording: its times and how much it holds."""
    span = part.span()
    found: dict[str, Any] = {"file": str(part.path), "messages": span.messages if span is not None else 0}
    if span is not None:
        found |= {"start_ns": span.first_ns, "span_s": round((span.last_ns - span.first_ns) * 1e-9, 3)}
    return found


def _systems(topics: list[dict[str, Any]]) -> dict[str, str]:
    """Per system 'yes', or what is missing."""
    from pfcli.formats.roles import ROLES

    have = {role for role, types in ROLES.items() if any(t["type"] in types and t["messages"] for t in topics)}
    if have & {"odometry", "encoders", "twist"}:
        have.add("motion")
    verdict = {}
    for system in registry.records().values():
        missing = min((need - have for need in system.needs), key=len)
        verdict[system.name] = "yes" if not missing else "needs " + ", ".join(sorted(missing))
    return verdict


def _lines(found: dict[str, Any]) -> Iterator[str]:
    date = f", {_date(found['start_ns'])}" if found["start_ns"] else ""
    yield f"{found['log']}: {found['messages']} messages, {found['span_s']:.3f} s, {found['bytes'] / 1e6:.1f} MB{date}"
    for part in found["parts"]:
        begin = f" from {_date(part['start_ns'])} on, {part['span_s']:.3f} s" if "start_ns" in part else ""
        yield f"  part {Path(part['file']).name}: {part['messages']} messages{begin}"
    if found["frames"]:
        yield f"  frames: {found['frames']}"
    for note in found["notes"]:
        yield f"  note: {note}"
    for t in found["topics"]:
        rate = f"{t['rate_hz']:.1f} Hz, longest gap {t['longest_gap_s']:.3f} s" if "rate_hz" in t else ""
        back = f", {t['backward_steps']} backward steps" if t.get("backward_steps") else ""
        yield f"  {t['topic']:<20} {t['type'] or '(no schema)':<32} {t['messages']:>8}  {rate}{back}"
    for name, verdict in found["systems"].items():
        yield f"  {name}: {verdict}"
