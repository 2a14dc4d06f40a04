"""Sample logs through their systems with the installed command, against golden figures."""

import subprocess
import sys
from pathlib import Path

import pytest

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"


def test_sample_logs_reach_their_golden_figures() -> None:
    import os

    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        [sys.executable, str(SAMPLES / "make.py"), "check"],
        capture_output=True,
        text=True,
        env={**os.environ, "PATH": path},
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "small-loop ate_m" in done.stdout


@pytest.mark.parametrize("log", sorted(p.name for p in SAMPLES.glob("*.mcap")))
def test_sample_logs_are_small(log: str) -> None:
    assert (SAMPLES / log).stat().st_size < 2_000_000


def test_sample_logs_are_made_again_byte_for_byte(tmp_path: Path, pfcli: object) -> None:
    import tomllib

    for name, row in tomllib.loads((SAMPLES / "samples.toml").read_text()).items():
        if isinstance(row, dict) and "simulate" in row:
            done = pfcli("simulate", row["simulate"][0], tmp_path / f"{name}.mcap", *row["simulate"][1:])  # type: ignore[operator]
            assert done.returncode == 0, done.stderr
            assert (tmp_path / f"{name}.mcap").read_bytes() == (SAMPLES / f"{name}.mcap").read_bytes()
