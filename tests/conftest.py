"""Shared fixtures: one kernel cache for the session, the sample logs, the installed command, the recorded logs."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("pfcli", deadline=None, derandomize=True, max_examples=60)
settings.load_profile("pfcli")

ROOT = Path(__file__).resolve().parents[1]
SAMPLES = ROOT / "sample_logs"
DATA = Path(os.environ.get("PFCLI_DATA", ROOT.parent / "shared" / "data"))


def needs(*names: str) -> Path:
    """The folder of recorded logs; skips with the name of the first file that is not there."""
    for name in names:
        if not (DATA / name).exists():
            pytest.skip(f"{DATA / name} is not there; set PFCLI_DATA")
    return DATA


@pytest.fixture(scope="session")
def sample() -> Callable[[str], Path]:
    """Path of a sample log."""
    return lambda name: SAMPLES / f"{name}.mcap"


@pytest.fixture(scope="session")
def pfcli() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the command line in a real subprocess."""

    def run(*words: object, **kwargs: object) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", "from pfcli.cli.app import run; run()", *map(str, words)]
        return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, **kwargs)  # type: ignore[call-overload, no-any-return]

    return run
