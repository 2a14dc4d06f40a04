"""The page that says how to add a system, followed to the letter: a package of its own, installed beside ours, green at once."""

import os
import re
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.packaging.wheels import ROOT, built

Cli = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A fresh environment with the wheel of pfcli; other packages are those of this one. No index: only what is built here can
    come under the name pfcli."""
    folder = tmp_path_factory.mktemp("fresh")
    venv.create(folder / "venv")
    python, wheel = folder / "venv/bin/python", built(ROOT, folder / "wheels")
    install = [sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-index", "--no-deps", wheel]
    done = subprocess.run(list(map(str, install)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (site,) = (folder / "venv/lib").glob("python*/site-packages")
    (site / "others.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    isolated = 'command=$1; shift; exec "{}" -m pip "$command" --no-build-isolation "$@"'  # the build backend is that of this one
    (folder / "venv/bin/pip").write_text(f"#!/bin/sh\n{isolated.format(python)}\n")
    (folder / "venv/bin/pip").chmod(0o755)
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    offline = {
        "PIP_NO_INDEX": "1",
        "PIP_NO_CACHE_DIR": "1",
        "PIP_NO_BUILD_ISOLATION": "0",
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
    }
    return kept | offline | {"PATH": f"{folder / 'venv/bin'}:{os.environ['PATH']}"}


def _sh(script: str, folder: Path, environment: dict[str, str]) -> str:
    words = ["bash", "-euo", "pipefail", "-c", script]
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_page_followed_to_the_letter_gives_a_system_that_is_green(
    environment: dict[str, str], tmp_path: Path
) -> None:
    where = _sh("python -c 'import pfcli; print(pfcli.__file__)'", tmp_path, environment)
    assert "/fresh" in where, "it is the pfcli of the wheel"
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / "docs/add-a-system.md").read_text(), re.S)
    said = _sh("\n".join(blocks), tmp_path, environment)
    assert "my-filter" in said
    assert len(re.findall(r"=+ \d+ passed in", said)) == 2, said
    assert (tmp_path / "out/my-filter/report.html").is_file()
    assert "my-filter" in _sh("pfcli --help", tmp_path, environment)
    assert "particles" in _sh("pfcli params my-filter", tmp_path, environment)
    assert "my-resampler" in _sh("pfcli slam-gdr --help-all", tmp_path, environment)


def test_what_is_written_passes_ruff_and_strict_mypy(pfcli: Cli, tmp_path: Path) -> None:
    done = pfcli("new-system", "of-mine", tmp_path / "x")
    assert done.returncode == 0, done.stderr
    for words in (
        ["ruff", "check", "--isolated", "--line-length=120", "--select=B,E,F,I,N,RUF,UP"],
        ["ruff", "format", "--isolated", "--line-length=120", "--check"],
        ["mypy", "--strict", "--config-file", "", "--ignore-missing-imports", "--follow-imports=silent"],
    ):
        typed = os.environ | {"MYPYPATH": str(ROOT)}
        run = subprocess.run([*words, "."], cwd=tmp_path / "x", env=typed, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("slam-gdr", "pfcli has a command of that name"),
        ("info", "pfcli has a command of that name"),
        ("My_Filter", "small letters, digits and single dashes"),
        ("-x", "No such option"),
    ],
)
def test_a_name_that_cannot_be_is_refused(name: str, says: str, pfcli: Cli, tmp_path: Path) -> None:
    done = pfcli("new-system", name, tmp_path / "x")
    assert done.returncode == 2
    assert says in done.stderr
    assert not (tmp_path / "x").exists()


def test_a_folder_that_is_not_empty_is_left_alone(pfcli: Cli, tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("x")
    done = pfcli("new-system", "my-filter", tmp_path)
    assert done.returncode == 1
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
