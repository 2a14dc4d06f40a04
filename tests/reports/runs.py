"""Short runs of every system on its sample log, for the tests of what shows them."""

from pathlib import Path
from typing import Any

from pfcli import registry
from pfcli.runs import loop, results
from tests.contracts.examples import job_of


def done(name: str, seed: int = 0, **params: Any) -> tuple[loop.Job, loop.Run]:
    """Six seconds of a system's sample log, with truth."""
    job = job_of(registry.system(name), params, seed=seed, truth="auto", command=("pfcli", name, "a b.mcap"))
    job = job._replace(settings=job.settings._replace(end_s=6.0))
    return job, loop.execute(job)


def short_run(name: str, folder: Path, seed: int = 0, **params: Any) -> Path:
    """The folder of such a run."""
    folder.mkdir(exist_ok=True)
    results.write(folder, *done(name, seed, **params))
    return folder
