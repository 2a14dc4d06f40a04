"""How commands speak: results to standard output, messages to standard error."""

import json
from typing import Any

import click

from pfcli.errors import EXIT_DONE, EXIT_PARTIAL, printable

_NOTES = 10


def say(text: str, quiet: bool = False) -> None:
    """A message to standard error."""
    if not quiet:
        click.echo(f"pfcli: {printable(text)}", err=True)


def emit(result: dict[str, Any], lines: list[str], as_json: bool) -> None:
    """The result: one JSON object, or lines to read."""
    click.echo(json.dumps(result) if as_json else "\n".join(map(printable, lines)))


def lost(counts: dict[str, int], notes: list[str], quiet: bool = False) -> int:
    """Say what was lost and give the exit code: 3 where part of the input was."""
    if not counts:
        return EXIT_DONE
    for note in notes[:_NOTES]:
        say(note, quiet)
    if len(notes) > _NOTES:
        say(f"and {len(notes) - _NOTES} more of that kind", quiet)
    total = ", ".join(f"{count} x {why}" for why, count in counts.items())
    say(f"part of the input was lost: {total}", quiet)
    return EXIT_PARTIAL
