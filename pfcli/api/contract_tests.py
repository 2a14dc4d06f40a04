"""What every system must keep, as functions that a package's own tests call: `docs/add-a-system.md`.

Each takes the case and an empty folder, and raises AssertionError. `CHECKS` has them all, for pytest's parametrize.
"""

import importlib
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pfcli import registry
from pfcli.cli.system_command import parsed
from pfcli.params import build, fields, to_toml
from pfcli.runs import loop
from pfcli.systems.shared.contract import Example, System

FILES = ("track.tum", "track.parquet", "metrics.parquet", "frames.parquet", "params.toml", "overlay.mcap")
"""What every run leaves, beside `run.json`, which has its times."""


class Case(NamedTuple):
    """A system, the folder in which the files of its example are, and more words for its command. PAPER.md names tests by
    their path from the folder above."""

    system: System
    samples: Path
    more: tuple[str, ...] = ()


def example_of(case: Case) -> Example:
    """The example that the record names."""
    assert case.system.example is not None, f"{case.system.name}: its record names no example"
    return case.system.example


def words_of(case: Case) -> list[str]:
    """The words of the command: log, options (files of the folder by their whole path), map."""
    example = example_of(case)
    options = [str(case.samples / word) if (case.samples / word).is_file() else word for word in example.options]
    flag = [f"--map={case.samples / example.map}"] if case.system.map else []
    return [*case.system.name.split(), str(case.samples / example.log), *options, *flag, *case.more]


def job_of(case: Case, params: dict[str, Any], **more: Any) -> loop.Job:
    """The example as a job with defaults but for these parameters; more: other fields of the job."""
    command, *words = words_of(case)
    job = parsed(command, [*words, "--out=unsaved"])
    return job._replace(params=build(case.system.params, params, "contract"), **more)


def same_bytes_with_1_and_2_threads_and_again(case: Case, folder: Path) -> None:
    """Seed, parameters and log decide every byte of every file."""
    for out, threads in (("a", 1), ("b", 2), ("c", 2)):
        _command(case, f"--out={folder / out}", f"--threads={threads}", "--overlay")
    files = {path.name for path in (folder / "a").iterdir()} - {"run.json"}
    assert files >= set(FILES), f"{sorted(set(FILES) - files)} are not there"
    for file in sorted(files):
        a, b, c = ((folder / out / file).read_bytes() for out in "abc")
        assert a == b, f"{file} is another one with two threads"
        assert b == c, f"{file} is another one when the run is repeated"
    assert (folder / "a" / "track.tum").read_bytes() != b"", "no pose is known"


def another_seed_gives_another_track(case: Case, folder: Path) -> None:
    """Random numbers come from the seed."""
    for seed in (1, 2):
        _command(case, f"--out={folder / str(seed)}", f"--seed={seed}")
    one, two = ((folder / seed / "track.tum").read_bytes() for seed in "12")
    assert one != two, "seeds 1 and 2 give the same track"


def a_second_run_compiles_nothing(case: Case, folder: Path) -> None:
    """Every kernel has one set of types, and the same run in one process gives the same poses."""
    import numba.core.event as events

    job = job_of(case, {"particles": 5} if "particles" in {field.name for field in fields(case.system.params)} else {})
    job = job._replace(settings=job.settings._replace(end_s=20.0))
    first = loop.execute(job)
    with events.install_recorder("numba:compile") as recorder:
        second = loop.execute(job)
    compiled = [event for _, event in recorder.buffer if event.is_start]
    assert not compiled, f"compiled again: {compiled}"
    assert np.array_equal(first.result.track.poses, second.result.track.poses, equal_nan=True)


def parameters_are_declared_and_survive_toml(case: Case, folder: Path) -> None:
    """Each parameter has help and a legal default; what `pfcli params` prints is read back."""
    params = case.system.params
    for field in fields(params):
        assert field.opt.help, f"{field.name} has no help"
        assert field.check(field.default, "default") == field.default
    assert build(params, tomllib.loads(to_toml(params())), "toml") == params()


def record_and_filter_belong_together(case: Case, folder: Path) -> None:
    """The record can be found by its name, and its charts draw columns that are there."""
    system = case.system
    assert registry.system(system.name) == system, "the entry point leads to another record"
    assert system.summary.endswith((".", "?")), "the summary is no sentence"
    assert len(system.summary) < 110, "the summary is longer than a line of --help"
    assert system.frame in ("own", "given")
    assert system.frame == "given" or not system.map, "who is given a map, is given its frame"
    columns = registry.filter_of(system).info._fields
    drawn = {series.column for chart in system.charts if chart.table == "metrics" for series in chart.series}
    missing = {name for name in drawn if not name.endswith("_smoothed")} - set(columns)
    assert not missing, f"charts draw {sorted(missing)}, which no row has"


def the_paper_page_names_what_exists(case: Case, folder: Path) -> None:
    """PAPER.md, beside the filter, has as many equations as the record says, each with a function and a test that are there."""
    module = importlib.import_module(case.system.filter.split(":")[0])
    text = (Path(str(module.__file__)).parent / "PAPER.md").read_text()
    tests = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text)
    names = re.findall(rf"`((?:pfcli|{module.__name__.split('.')[0]})(?:\.\w+)+)`", text)
    assert (
        len({line for line in text.splitlines() if re.search(r"`tests/[\w/]+\.py::\w+`", line)})
        >= case.system.equations
    )
    assert len(names) >= case.system.equations
    missing = [name for name in names if not _exists(name)] + [
        f"{file}::{test}" for file, test in tests if f"def {test}(" not in (case.samples.parent / file).read_text()
    ]
    assert not missing, f"PAPER.md names {missing}"


CHECKS: Iterable[Callable[[Case, Path], None]] = (
    same_bytes_with_1_and_2_threads_and_again,
    another_seed_gives_another_track,
    a_second_run_compiles_nothing,
    parameters_are_declared_and_survive_toml,
    record_and_filter_belong_together,
    the_paper_page_names_what_exists,
)


def a_resampler_is_unbiased(function: Callable[..., Any]) -> None:
    """What `--resampler` may name (`core.resample.schemes`): count * weight offspring of each on average, for any count, and
    the same again from the same generator."""
    weights, runs = np.array([0.05, 0.5, 0.15, 0.3]), 4000
    for count in (1, 4, 9):
        rng, counts = np.random.default_rng(count), np.zeros(4)
        for _ in range(runs):
            found = np.asarray(function(weights, count, rng))
            assert found.dtype == np.int64, f"{found.dtype}, not int64"
            assert found.shape == (count,), f"{found.shape}, not {(count,)}"
            counts += np.bincount(found, minlength=4)
        # the variance of a count is that of independent draws at the most, count / 4: six standard errors of the mean
        assert np.abs(counts / runs - count * weights).max() < 6 * np.sqrt(count / 4 / runs), (
            f"biased for {count} offspring"
        )
    a, b = (function(weights, 9, np.random.default_rng(1)) for _ in range(2))
    assert np.array_equal(a, b), "another choice from the same generator"


def _command(case: Case, *words: str) -> None:
    """Run the command in a process of its own."""
    call = [sys.executable, "-m", "pfcli", *words_of(case), *words]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def _exists(name: str) -> bool:
    """Whether a module, or an attribute of one, has this name."""
    parent, _, attribute = name.rpartition(".")
    try:
        if hasattr(importlib.import_module(parent), attribute):
            return True
        importlib.import_module(name)
    except ModuleNotFoundError:
        return False
    return True
