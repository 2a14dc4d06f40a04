"""How commands speak: results to standard output, messages to standard error."""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import click

from pfcli.errors import EXIT_DONE, EXIT_NOT_PASSED, EXIT_PARTIAL, printable
from pfcli.findings import Finding

_NOTES = 10


def say(text: str, quiet: bool = False) -> None:
    """A message to standard error."""
    if not quiet:
        click.echo(f"pfcli: {printable(text)}", err=True)


def emit(result: dict[str, Any], lines: list[str], as_json: bool) -> None:
    """The result: one JSON object, or lines to read."""
    if as_json:
        click.echo(json.dumps(result))
    for line in lines if not as_json else []:
        click.echo(printable(line))


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


def tell(findings: Sequence[Finding], counts: dict[str, int], *, quiet: bool = False, strict: bool = False) -> int:
    """Say what a run noticed, one line each, and give the exit code: 3 where a loss or a doubt is among it (strict: 4).

    counts: what was lost, for the last line.
    """
    for found in findings:
        say(found.line, quiet)
    if any(found.severity == "loss" for found in findings) and counts:
        say("part of the input was lost: " + ", ".join(f"{n} x {why}" for why, n in counts.items()), quiet)
    return verdict_code(findings, strict=strict)


def verdict_code(findings: Sequence[Finding], *, strict: bool = False) -> int:
    """The exit code that findings ask for."""
    if not any(found.shakes for found in findings):
        return EXIT_DONE
    return EXIT_NOT_PASSED if strict else EXIT_PARTIAL


@contextmanager
def compiling(quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """What says how far compiling is: over and over in one line of a terminal, once elsewhere."""
    terminal = sys.stderr.isatty()
    said: list[str] = []

    def hear(text: str) -> None:
        if not quiet and (terminal or not said):
            click.echo(f"\rpfcli: {text} " if terminal else f"pfcli: {text}", err=True, nl=not terminal)
        said.append(text)

    yield hear
    if terminal and said and not quiet:
        click.echo(err=True)
