"""`pfcli check`, and findings of a run on the command line."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

from tests.checks import mutations
from tests.checks.mutations import SCANS, STAMPS, Mutation
from tests.conftest import SAMPLES

Cli = Callable[..., subprocess.CompletedProcess[str]]


def _written(name: str, target: Path) -> Path:
    (mutation,) = [m for m in STAMPS + SCANS if m.name == name]
    chosen: Mutation = mutation
    return mutations.write(SAMPLES / "small-loop.mcap", target / "log.mcap", chosen)


def test_check_says_code_place_and_flag_and_ends_with_3(pfcli: Cli, tmp_path: Path) -> None:
    log = _written("laser-turned-180", tmp_path)
    done = pfcli("check", log)
    assert done.returncode == 3
    assert "W305" in done.stdout
    assert "--extrinsic base_link:" in done.stdout
    assert pfcli("check", log, "--strict").returncode == 4
    assert pfcli("check", log, "--ignore", "W305").returncode == 0
    told = json.loads(pfcli("info", "--check", log, "--json").stdout)
    assert [found["code"] for found in told["findings"]] == ["W305"]


def test_check_of_a_clean_log_ends_with_0(pfcli: Cli) -> None:
    done = pfcli("check", SAMPLES / "small-loop.mcap")
    assert (done.returncode, done.stderr) == (0, "")
    assert "no findings" in done.stdout


def test_a_run_has_a_verdict(pfcli: Cli, tmp_path: Path) -> None:
    done = pfcli("slam-gdr", SAMPLES / "small-loop.mcap", "--out", tmp_path / "out", "--end", "40")
    assert "verdict: good" in done.stdout
    assert json.loads((tmp_path / "out/run.json").read_text())["verdict"]["grade"] == "good"


def test_an_unknown_code_is_refused(pfcli: Cli) -> None:
    done = pfcli("check", SAMPLES / "small-loop.mcap", "--ignore", "W999")
    assert done.returncode == 2
    assert "W999" in done.stderr


def test_a_run_says_what_it_doubts(pfcli: Cli, tmp_path: Path) -> None:
    log, out = _written("scan-0.3-s-late", tmp_path), tmp_path / "out"
    done = pfcli("slam-gdr", log, "--out", out, "--end", "60")
    assert done.returncode == 3
    assert "W107" in done.stderr
    assert "--time-offset scan=-0.3" in done.stderr
    assert "W107" in [found["code"] for found in json.loads((out / "run.json").read_text())["findings"]]
    mended = pfcli(
        "slam-gdr", log, "--out", tmp_path / "mended", "--end", "60", "--time-offset", "scan=-0.3", "--ignore", "W104"
    )
    assert mended.returncode == 0, mended.stderr
    assert pfcli("slam-gdr", log, "--out", tmp_path / "strict", "--end", "60", "--strict").returncode == 4


def test_a_log_whose_stamps_stand_still_is_refused_with_the_way_out(pfcli: Cli, tmp_path: Path) -> None:
    log = _written("scan-stamps-equal", tmp_path)
    done = pfcli("slam-gdr", log, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "--time log" in done.stderr
    assert not (tmp_path / "out").exists()
