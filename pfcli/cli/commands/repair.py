"""`pfcli repair IN OUT`."""

from pathlib import Path

import click

from pfcli.cli.types import Readable, max_chunk_option, streamed
from pfcli.errors import UsageError
from pfcli.formats.atomic import check_file


@click.command()
@click.argument("source", type=Readable())
@click.argument("target", type=click.Path(path_type=Path))
@click.option("--compression", type=click.Choice(["zstd", "lz4", "none"]), default="zstd", show_default=True)
@max_chunk_option
@click.option("--force", is_flag=True, help="Replace TARGET.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as one JSON object.")
def repair(source: Path, target: Path, compression: str, max_chunk_mib: float, force: bool, as_json: bool) -> int:
    """Write what can be read of SOURCE, a damaged or odd MCAP log, as a clean, indexed MCAP log: every topic, byte for byte,
    attachments and metadata too. `-`: standard input or output.

    Exit code 3 and where the damage is, if something was lost.

    Example: pfcli repair crashed.mcap whole.mcap
    """
    from pfcli.cli.printing import emit, lost
    from pfcli.formats import mcap_repair

    with streamed(target) as place:
        check_file(place, force=force)
        if place.exists() and place.samefile(source):
            raise UsageError(f"{target}: is the log itself; what cannot be read of it would be gone: name another file")
        found = mcap_repair.repair(source, place, compression, max_chunk_mib)
        values = {"out": str(target), "messages": found.messages, "topics": found.topics, "extras": found.extras}
        values |= {"missing": found.missing, "damage": found.losses}
        line = f"{target}: {found.messages} messages of {found.topics} topics, {found.extras} attachments and metadata"
        emit(values, [line], as_json)
    counts = {"damaged place": len(found.losses)} if found.losses else {}
    return lost(counts | ({"missing message": found.missing} if found.missing else {}), found.losses)
