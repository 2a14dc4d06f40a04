"""`pfcli check LOG...`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from pfcli.cli.options import finding_options, reading_options, settings_of
from pfcli.cli.types import Readable
from pfcli.replay.settings import Settings


@click.command()
@click.argument("logs", nargs=-1, required=True, type=Readable())
@click.option("--deep", is_flag=True, help="Match every pair of scans, not a sample of them.")
@click.option("--json", "as_json", is_flag=True, help="Print the findings as one JSON object.")
@finding_options
@reading_options
def check(logs: tuple[Path, ...], **given: Any) -> int:
    """What is wrong with a log, before a run: stamps and clocks, units and signs, mounts, what was lost. LOGS: the parts of one
    recording. docs/checks.md has every check.

    Exit code 0: nothing was found that shakes a result; 3: something was (--strict: 4).

    Example: pfcli check drive.mcap --json | jq -r .findings[].code
    """
    return checked(logs, settings_of(given), given)


def checked(logs: Sequence[Path], settings: Settings, given: dict[str, Any]) -> int:
    """Check one recording and print what was found. given: deep, ignore, strict, as_json."""
    from pfcli.checks.log_check import check_log
    from pfcli.cli.printing import emit, verdict_code
    from pfcli.findings import as_rows

    found = check_log(logs, settings, deep=given["deep"], ignore=given["ignore"])
    result = {
        "log": str(logs[0]),
        "read": found.read,
        "topics": found.topics,
        "findings": as_rows(found.findings),
    }
    count = sum(found.read.values())
    tail = f"{logs[0]}: {count} messages looked at, {len(found.findings) or 'no'} findings"
    emit(result, [*(finding.line for finding in found.findings), tail], given["as_json"])
    return verdict_code(found.findings, strict=given["strict"])
