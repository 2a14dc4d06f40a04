"""What every registered system must keep: bytes that repeat, no new compilation, declared parameters and rows."""

import importlib
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pfcli import registry
from pfcli.params import build, fields, to_toml
from pfcli.systems.shared.contract import System
from tests.contracts.examples import RECORDS, example_of, job_of, words_of

Cli = Callable[..., "subprocess.CompletedProcess[str]"]
ROOT = Path(__file__).resolve().parents[2]
MORE = {"slam-gdr-smooth": (RECORDS["slam-gdr"], ["--end", "100", "--particles", "2", "--smooth"])}
"""Runs of other kinds."""
RUNS = {key: (system, []) for key, system in RECORDS.items()} | MORE
FILES = (
    "track.tum",
    "track.parquet",
    "metrics.parquet",
    "frames.parquet",
    "params.toml",
    "overlay.mcap",
)


@pytest.mark.parametrize("name", list(RUNS))
def test_the_same_command_gives_the_same_bytes_with_1_and_2_threads_and_again(
    name: str, pfcli: Cli, tmp_path: Path
) -> None:
    system, more = RUNS[name]
    for out, threads in (("a", 1), ("b", 2), ("c", 2)):
        done = pfcli(*words_of(system), "--out", tmp_path / out, "--threads", threads, "--overlay", *more)
        assert done.returncode == 0, done.stderr
    wall_clock = {"run.json"}
    files = {path.name for path in (tmp_path / "a").iterdir()} - wall_clock
    assert files >= set(FILES)
    for file in files:
        a, b, c = ((tmp_path / out / file).read_bytes() for out in "abc")
        assert a == b == c, file
    assert (tmp_path / "a" / "track.tum").read_bytes() != b""


@pytest.mark.parametrize("system", RECORDS.values(), ids=RECORDS)
def test_another_seed_gives_another_track(system: System, pfcli: Cli, tmp_path: Path) -> None:
    for seed in (1, 2):
        pfcli(*words_of(system), "--out", tmp_path / str(seed), "--seed", seed)
    assert (tmp_path / "1/track.tum").read_bytes() != (tmp_path / "2/track.tum").read_bytes()


@pytest.mark.parametrize("system", RECORDS.values(), ids=RECORDS)
def test_a_second_run_compiles_nothing(system: System) -> None:
    import numba.core.event as events

    from pfcli.runs import loop

    job = job_of(system, {"particles": 5})
    job = job._replace(settings=job.settings._replace(end_s=20.0))
    first = loop.execute(job)
    with events.install_recorder("numba:compile") as recorder:
        second = loop.execute(job)
    assert [e for _, e in recorder.buffer if e.is_start] == []
    assert np.array_equal(first.result.track.poses, second.result.track.poses, equal_nan=True)


@pytest.mark.parametrize("system", RECORDS.values(), ids=RECORDS)
def test_parameters_are_declared_with_help_and_survive_toml(system: System) -> None:
    import tomllib

    for field in fields(system.params):
        assert field.opt.help, field.name
        assert field.check(field.default, "default") == field.default
    assert build(system.params, tomllib.loads(to_toml(system.params())), "toml") == system.params()


@pytest.mark.parametrize("system", RECORDS.values(), ids=RECORDS)
def test_the_record_and_its_filter_belong_together(system: System) -> None:
    """Charts draw columns that are there, an example is there, `map` means a frame that is given."""
    assert system.summary.endswith((".", "?"))
    assert len(system.summary) < 110
    assert system.frame in ("own", "given")
    assert system.frame == "given" or not system.map
    assert example_of(system).log
    columns = set(registry.filter_of(system).info._fields)
    drawn = {series.column for chart in system.charts if chart.table == "metrics" for series in chart.series}
    smoothed = {name for name in drawn if name.endswith("_smoothed")}
    assert drawn - smoothed <= columns


def test_reading_all_records_imports_no_kernel_and_no_table() -> None:
    code = (
        "import sys; from pfcli import registry; assert len(registry.records()) >= 6;"
        "bad = {'numba', 'scipy', 'pyarrow', 'matplotlib', 'rosbags'} & set(sys.modules); assert not bad, bad"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_checkout_that_is_not_installed_says_how(tmp_path: Path) -> None:
    """Without its entry points there is no system: one line with the way out."""
    code = (
        "import importlib.metadata as m; m.entry_points = lambda **_: m.EntryPoints(());"
        "from pfcli.cli.app import run; import sys; sys.argv = ['pfcli', 'slam-gdr', 'x.mcap', '--out', 'o']; run()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "pfcli: pfcli is not installed, so its systems cannot be found: pip install -e .\n"


@pytest.mark.parametrize("system", RECORDS.values(), ids=RECORDS)
def test_the_paper_page_names_what_exists(system: System) -> None:
    import re

    module = importlib.import_module(system.filter.split(":")[0])
    text = (Path(str(module.__file__)).parent / "PAPER.md").read_text()
    rows = [line for line in text.splitlines() if re.search(r"`tests/[\w/]+\.py::\w+`", line)]
    assert len(rows) >= system.equations
    names = re.findall(r"`(pfcli(?:\.\w+)+)`", text)
    assert len(names) >= system.equations
    for full in names:
        module_name, attribute = full.rsplit(".", 1)
        try:
            found = importlib.import_module(module_name)
        except ModuleNotFoundError:
            pytest.fail(f"{full}: no such module")
        assert hasattr(found, attribute) or importlib.import_module(full), full
    for file, test in re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text):
        assert f"def {test}" in (ROOT / file).read_text(), test
