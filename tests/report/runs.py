"""Short runs of every system on its sample log, for the tests of what shows them."""

from pathlib import Path
from typing import Any

from pfcli import registry, results, run
from pfcli.dead_reckoning import Drive
from pfcli.params import build
from pfcli.replay import Settings
from tests.contracts.test_systems import DRIVES, MAPS, RUNS, SAMPLES


def done(name: str, seed: int = 0, **params: Any) -> tuple[run.Job, run.Run]:
    """Six seconds of a system's sample log, with truth."""
    system = registry.system(name)
    drive = DRIVES.get(name, Drive(radius_m=(0.1,), track_m=0.33))
    built, log = build(system.params, params, "test"), SAMPLES / f"{RUNS[name][0]}.mcap"
    job = run.Job(system, built, [log], seed, Settings(end_s=6.0), drive=drive, truth="auto", map=MAPS.get(name))
    job = job._replace(command=("pfcli", name, "a b.mcap"))
    return job, run.execute(job)


def short_run(name: str, folder: Path, seed: int = 0, **params: Any) -> Path:
    """The folder of such a run."""
    folder.mkdir(exist_ok=True)
    results.write(folder, *done(name, seed, **params))
    return folder
