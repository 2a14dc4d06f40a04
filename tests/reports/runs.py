"""Short runs of every system on its sample log, for the tests of what shows them."""

from pathlib import Path
from typing import Any

from pfcli import registry
from pfcli.params import build
from pfcli.replay.dead_reckoning import Drive
from pfcli.replay.log import Settings
from pfcli.runs import loop, results
from tests.contracts.test_systems import DRIVES, MAPS, RUNS, SAMPLES


def done(name: str, seed: int = 0, **params: Any) -> tuple[loop.Job, loop.Run]:
    """Six seconds of a system's sample log, with truth."""
    system = registry.system(name)
    drive = DRIVES.get(name, Drive(radius_m=(0.1,), track_m=0.33))
    built, log = build(system.params, params, "test"), SAMPLES / f"{RUNS[name][0]}.mcap"
    job = loop.Job(system, built, [log], seed, Settings(end_s=6.0), drive=drive, truth="auto", map=MAPS.get(name))
    job = job._replace(command=("pfcli", name, "a b.mcap"))
    return job, loop.execute(job)


def short_run(name: str, folder: Path, seed: int = 0, **params: Any) -> Path:
    """The folder of such a run."""
    folder.mkdir(exist_ok=True)
    results.write(folder, *done(name, seed, **params))
    return folder
