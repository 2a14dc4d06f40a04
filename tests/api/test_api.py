"""The Python API: the run of the command, its result in memory, and an import that stays cheap."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import pfcli as api
from pfcli import registry
from pfcli.api import keyword_options
from pfcli.errors import LogError, PfcliError, UsageError
from pfcli.formats import tum

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "sample_logs"
Cli = Callable[..., "subprocess.CompletedProcess[str]"]


def _python(code: str, **more: Any) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, **more)


def _same(a: Any, b: Any) -> bool:
    """Tables with the same values (NaN is NaN), units and provenance."""
    return bool(a.schema.equals(b.schema, check_metadata=True) and a.to_pandas().equals(b.to_pandas()))


def test_importing_pfcli_imports_nothing_heavy() -> None:
    code = (
        "import sys, pfcli; dir(pfcli);"
        "bad = {'numpy', 'numba', 'scipy', 'pyarrow', 'matplotlib', 'click', 'pfcli.api'} & set(sys.modules); assert not bad, bad"
    )
    done = _python(code)
    assert done.returncode == 0, done.stderr


def test_importing_any_module_replaces_no_public_function() -> None:
    code = (
        "import importlib, pkgutil, pfcli\n"
        "names = [n for n in pfcli.__all__ if n != '__version__']\n"
        "before = {n: getattr(pfcli, n) for n in names}\n"
        "for module in pkgutil.walk_packages(pfcli.__path__, 'pfcli.'):\n"
        "    if not module.name.endswith('__main__'): importlib.import_module(module.name)\n"
        "import types\n"
        "assert all(getattr(pfcli, n) is before[n] for n in names)\n"
        "assert not any(isinstance(getattr(pfcli, n), types.ModuleType) for n in names)\n"
    )
    done = _python(code)
    assert done.returncode == 0, done.stderr


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'runn'"):
        _ = api.runn  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def loop_run() -> api.FinishedRun:
    return api.run("slam-gdr", SAMPLES / "small-loop.mcap", particles=4, truth="auto", end=15, threads=1, seed=3)


def test_a_saved_run_is_the_run_of_its_command(loop_run: api.FinishedRun, pfcli: Cli, tmp_path: Path) -> None:
    words = ("--particles", 4, "--seed", 3, "--truth", "auto", "--end", 15, "--overlay", "--plot", tmp_path / "a.png")
    done = pfcli("slam-gdr", SAMPLES / "small-loop.mcap", *words, "--out", tmp_path / "a")
    assert done.returncode == 0, done.stderr
    loop_run.save(tmp_path / "b", overlay=True)
    loop_run.plot(tmp_path / "b.png")
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert files == sorted(path.name for path in (tmp_path / "b").iterdir())
    for name in files:
        if name != "run.json":
            assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    a, b = (json.loads((tmp_path / out / "run.json").read_text()) for out in "ab")
    wall_clock = {"command", "seconds", "ms_per_update", "update_ms"}
    assert {k: v for k, v in a.items() if k not in wall_clock} == {k: v for k, v in b.items() if k not in wall_clock}
    # and the command that the run names gives the same bytes once more
    assert pfcli(*b["command"].split()[1:], "--force").returncode == 0
    assert (tmp_path / "a/track.parquet").read_bytes() == (tmp_path / "b/track.parquet").read_bytes()


def test_tables_have_units_and_are_those_of_the_files(loop_run: api.FinishedRun, tmp_path: Path) -> None:
    folder = loop_run.save(tmp_path / "run")
    assert _same(loop_run.track, pq.read_table(folder / "track.parquet"))
    assert _same(loop_run.metrics, pq.read_table(folder / "metrics.parquet"))
    assert loop_run.track.schema.field("cov_xx_m2").metadata == {b"unit": b"m^2"}
    assert set(loop_run.tables) == {"track", "metrics", "frames", "closures"}
    assert loop_run.errors is not None
    assert np.array_equal(loop_run.track["error_m"].to_numpy(), loop_run.errors.position_m, equal_nan=True)
    assert loop_run.grid is not None
    assert loop_run.summary["scans"] == loop_run.track.num_rows
    frame = loop_run.track.to_pandas()
    assert list(frame.columns[:4]) == ["t_ns", "x_m", "y_m", "yaw_rad"]


def test_a_run_that_is_saved_over_another_says_so(loop_run: api.FinishedRun, tmp_path: Path) -> None:
    loop_run.save(tmp_path / "run")
    with pytest.raises(PfcliError, match="force"):
        loop_run.save(tmp_path / "run")
    loop_run.save(tmp_path / "run", force=True, report=True)
    assert (tmp_path / "run/report.html").is_file()


def test_a_notebook_shows_the_picture_and_leaves_its_own_figures_alone(loop_run: api.FinishedRun) -> None:
    import matplotlib

    before = matplotlib.get_backend(), matplotlib.rcParams["svg.hashsalt"]
    assert loop_run._repr_png_().startswith(b"\x89PNG")
    text = loop_run._repr_html_()
    assert "data:image/png;base64," in text
    assert "ate_m" in text
    assert (matplotlib.get_backend(), matplotlib.rcParams["svg.hashsalt"]) == before
    assert repr(loop_run) == f"<slam-gdr: {loop_run.track.num_rows} scans, {loop_run.metrics.num_rows} updates>"


def test_options_of_all_kinds_become_words() -> None:
    def run_words(system: str, options: dict[str, Any]) -> list[str]:
        return keyword_options.run_words(registry.system(system), options)

    topics = {"scan": "/front", "odometry": "/odom"}
    assert run_words("slam-gdr", {"topic": topics}) == ["--topic=scan=/front", "--topic=odometry=/odom"]
    assert run_words("slam-gdr", {"extrinsic": ["base:laser=0,0,0"]}) == ["--extrinsic=base:laser=0,0,0"]
    assert run_words("slam-gdr", {"extrinsic": {"base:laser": (0.1, 0, 0)}}) == ["--extrinsic=base:laser=0.1,0,0"]
    assert run_words("slam-gdr", {"smooth": False, "particles": None}) == ["--no-smooth"]
    assert run_words("slam-gdr", {"alpha_xy_m": np.float64(0.1)}) == ["--alpha-xy-m=0.1"]
    assert run_words("localize-lookup", {"initial": (1.0, -2.0, 0)}) == ["--initial=1.0,-2.0,0"]
    params = replace(api.default_params("slam-gdr"), particles=3, smooth=False)
    assert run_words("slam-gdr", {"seed": 1, "params": params}) == ["--particles=3", "--no-smooth", "--seed=1"]


def test_parameters_as_an_object_are_those_of_the_run(loop_run: api.FinishedRun) -> None:
    params = replace(api.default_params("slam-gdr"), particles=4)
    again = api.run("slam-gdr", [SAMPLES / "small-loop.mcap"], params=params, seed=3, truth="auto", end=15)
    assert again.params == params == loop_run.params
    assert _same(again.track, loop_run.track)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"particels": 1}, "No such option.*--particels"),
        ({"particles": 0}, "particles = 0 is outside"),
        ({"out": "x"}, r"out= is an option of the command only; the run has \.save"),
        ({"topic": {"radar": "/x"}}, "NAME one of"),
        ({"params": api.default_params("localize-lookup")}, "params= is for another system"),
    ],
)
def test_what_the_command_refuses_is_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        api.run("slam-gdr", SAMPLES / "small-loop.mcap", **options)


def test_unknown_systems_and_logs_are_named() -> None:
    with pytest.raises(UsageError, match="there is no system 'slam'"):
        api.run("slam", SAMPLES / "small-loop.mcap")
    with pytest.raises(LogError, match=r"none\.mcap"):
        api.open("none.mcap")
    assert "/scan" in repr(api.open(SAMPLES / "small-loop.mcap"))


def test_a_loss_is_a_warning(tmp_path: Path) -> None:
    whole = (SAMPLES / "small-loop.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 3])
    with pytest.warns(api.DoubtfulResult, match="W601"):
        run = api.run("slam-gdr", tmp_path / "cut.mcap", particles=2, end=10)
    assert run.findings


def test_a_track_is_judged_as_the_command_judges_it(loop_run: api.FinishedRun, pfcli: Cli, tmp_path: Path) -> None:
    folder, truth = loop_run.save(tmp_path / "run"), SAMPLES / "small-loop.mcap"
    done = pfcli("evaluate", folder / "track.tum", "--truth", truth, "--rpe-delta", 5, "--json")
    assert api.evaluate(folder / "track.tum", truth, rpe_delta=5) == json.loads(done.stdout)["truth"]
    assert api.evaluate(loop_run, truth)["ate_m"] == pytest.approx(
        api.evaluate(folder / "track.tum", truth)["ate_m"], abs=1e-5
    )
    assert api.evaluate(loop_run, loop_run)["max_m"] == pytest.approx(0.0, abs=1e-9)
    (tmp_path / "renamed").write_bytes(truth.read_bytes())
    assert api.evaluate(loop_run, tmp_path / "renamed") == api.evaluate(loop_run, truth), (
        "what it is, not what it is called"
    )
    with pytest.raises(LogError, match="cannot be read"):
        api.evaluate(loop_run, tmp_path / "none.tum")
    stamps, poses = tum.read(folder / "track.tum")
    tum.write(tmp_path / "far.tum", stamps + 10**12, poses)
    with pytest.raises(LogError, match="no stamp"):
        api.evaluate(loop_run, tmp_path / "far.tum")


def test_the_names_of_systems_and_resamplers() -> None:
    assert api.list_systems()["slam-gdr --landmarks"].endswith(".")
    assert api.list_resamplers()["systematic"].startswith("Evenly spaced")


def test_the_page_on_python_runs_as_it_stands(tmp_path: Path) -> None:
    (tmp_path / "sample_logs").symlink_to(SAMPLES)
    (tmp_path / "out").mkdir()
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs/python.md").read_text(), re.S)
    assert len(blocks) == 7
    body = [line for line in blocks[-1].splitlines() if line and not line.startswith(("import", "from"))]
    assert len(body) <= 30
    done = _python("import warnings; warnings.simplefilter('error')\n" + "\n".join(blocks), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == re.search(r"print\(run\)  # (.*)", blocks[0])[1]  # type: ignore[index]
    assert "No such option" in lines[-2]
    assert "--particels" in lines[-2]
    rmse = float(re.search(r"RMSE ([\d.]+) m", lines[-1])[1])  # type: ignore[index]
    assert rmse < 0.05  # a cell of the map


def test_the_page_lists_what_is_public() -> None:
    page = (ROOT / "docs/python.md").read_text()
    for name in api.__all__:
        if name != "__version__":
            assert f"`{name}`" in page, name
