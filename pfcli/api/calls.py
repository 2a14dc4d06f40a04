"""The functions of the Python API."""

import gc
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pfcli import registry
from pfcli.api.finished_run import DoubtfulResult, FinishedRun
from pfcli.api.keyword_options import run_words
from pfcli.cli.system_command import parsed
from pfcli.errors import LogError
from pfcli.replay.log import Log
from pfcli.runs import judge, loop

PathLike = str | os.PathLike[str]
Paths = PathLike | Sequence[PathLike]


def open(paths: Paths) -> Log:
    """A recording: a file, the list of its parts, or its folder. Raises LogError where it cannot be read."""
    return Log([Path(path) for path in _listed(paths)])


def run(system: str, log: Log | Paths, **options: Any) -> FinishedRun:
    """Replay a recording through a system: the run of `pfcli SYSTEM LOG --option value ...`, with the same result.

    system: as `pfcli --help` lists it, such as `"slam-gdr"` or `"slam-gdr --landmarks"`. options: those of the command, `-` as
    `_` (`particles=10, seed=1, map="map.yaml", truth="auto"`). A flag is True or False; an option that may be repeated takes a
    list, or a mapping (`topic={"scan": "/front"}`); numbers with commas may be a tuple (`initial=(1.0, 2.0, 0.0)`); `params` is
    a TOML file or what `default_params` gave, changed with `dataclasses.replace`. Files are written by the run's `save`.

    Raises UsageError and LogError as the command ends with one line; warns with DoubtfulResult where it ends with code 3.
    """
    record = registry.system(system)
    name, *flags = record.name.split()
    paths = log.paths if isinstance(log, Log) else _listed(log)
    # a file whose name begins with a dash is no option
    files = [f"./{path}" if str(path).startswith("-") else str(path) for path in paths]
    words = [*files, *flags, *run_words(record, options)]
    job = parsed(name, ["--out=unsaved", *words])._replace(command=("pfcli", name, *words))
    if "progress" not in options:
        job = job._replace(progress="never")
    try:
        done = FinishedRun(job, loop.execute(job))
    finally:
        gc.unfreeze()
    for finding in done.findings:
        if finding.shakes:
            warnings.warn(finding.line, DoubtfulResult, stacklevel=2)
    return done


def list_systems() -> dict[str, str]:
    """Name -> what it does, of every installed system and variant."""
    return {system.name: system.summary for system in registry.records().values()}


def list_resamplers() -> dict[str, str]:
    """Name -> what it does, of every installed resampler; `--resampler` takes these."""
    docs = {name: registry.resampler(name).__doc__ or "" for name in registry.resampler_names()}
    return {name: text.strip().partition("\n")[0] for name, text in docs.items()}


def default_params(system: str) -> Any:
    """The parameters of a system, with its defaults: a frozen dataclass."""
    return registry.system(system).params()


def evaluate(
    track: "FinishedRun | PathLike",
    truth: "FinishedRun | PathLike",
    *,
    align: bool = True,
    max_gap_s: float = 0.02,
    rpe_delta: int = 1,
) -> dict[str, Any]:
    """Figures of a track against truth, as `pfcli evaluate --truth --json` gives them: `ate_m`, `mean_m`, `rpe_m`, `rpe_deg`, ...

    track, truth: a run, a TUM file, or (truth) a recording with a truth topic. align: move the track onto its truth first
    (SE(2), least squares); max_gap_s: stamps so far apart are still one; rpe_delta: RPE over so many poses. Raises LogError.
    """
    rule = judge.Rule(align, int(max_gap_s * 1e9), rpe_delta)
    return judge.judged(_poses(track), _poses(truth), rule)[0]


def _poses(given: "FinishedRun | PathLike") -> judge.Poses:
    if not isinstance(given, FinishedRun):
        return judge.truth_of(Path(given))
    found = given.result.track
    known = np.isfinite(found.poses).all(axis=1)
    if not known.any():
        raise LogError(f"{given}: no pose is known")
    return judge.Poses(found.stamps_ns[known], found.poses[known], repr(given))


def _listed(paths: Paths) -> Sequence[PathLike]:
    return [paths] if isinstance(paths, str | os.PathLike) else paths
