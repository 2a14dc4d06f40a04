"""One job of a batch, wherever it runs."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pfcli.errors import EXIT_DONE, EXIT_PARTIAL
from pfcli.outputs import output_dir


def perform(system: str, words: Sequence[str], record: dict[str, Any], target: Path) -> int:
    """Run the job and write its folder in one rename; 0, or 3 where part of the input was lost. Raises PfcliError."""
    from pfcli import results, run
    from pfcli.commands.system import parsed

    words = (*words, "--out", str(target))
    job = parsed(system, words)._replace(command=("pfcli", system, *words))
    done = run.execute(job)
    code = EXIT_PARTIAL if done.loss else EXIT_DONE
    with output_dir(target, force=True) as folder:
        results.write(folder, job, done)
        (folder / "job.json").write_text(json.dumps({**record, "exit": code}, indent=2) + "\n")
    return code


def fault(error: BaseException) -> str:
    """One line that says why a job failed."""
    from pfcli.errors import PfcliError

    text = " ".join(str(error).split())
    return text if isinstance(error, PfcliError) else f"{type(error).__name__}: {text}"
