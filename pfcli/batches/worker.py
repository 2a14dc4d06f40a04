"""One job of a batch, wherever it runs."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pfcli.errors import EXIT_DONE, EXIT_PARTIAL
from pfcli.formats.atomic import output_dir

if TYPE_CHECKING:
    from pfcli.runs.loop import Job


class Flag(NamedTuple):
    """A flag of a system's command. multiple: it may be given several times; on_off: it has a `--no-` form."""

    multiple: bool
    on_off: bool


class CommandLine(NamedTuple):
    """How the words of a job are read: functions of a module, so that worker processes find them by name.

    job(system, words) -> Job, raises UsageError; flags(system) -> flag -> Flag.
    """

    job: "Callable[[str, Sequence[str]], Job]"
    flags: Callable[[str], Mapping[str, Flag]]


def perform(cli: CommandLine, system: str, words: Sequence[str], record: dict[str, Any], target: Path) -> int:
    """Run the job and write its folder in one rename; 0, or 3 where a finding says loss or doubt. Raises PfcliError."""
    from pfcli.runs import loop, results

    words = (*words, "--out", str(target))
    job = cli.job(system, words)._replace(command=("pfcli", system, *words))
    done = loop.execute(job)
    code = EXIT_PARTIAL if any(found.shakes for found in done.findings) else EXIT_DONE
    with output_dir(target, force=True) as folder:
        results.write(folder, job, done)
        (folder / "job.json").write_text(json.dumps({**record, "exit": code}, indent=2) + "\n")
    return code


def fault(error: BaseException) -> str:
    """One line that says why a job failed."""
    from pfcli.errors import PfcliError

    text = " ".join(str(error).split())
    return text if isinstance(error, PfcliError) else f"{type(error).__name__}: {text}"
