"""Killed, full, read-only, linked: what a command leaves behind, whatever happens to it."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pfcli.core.jit import cache_root
from pfcli.events import Odometry, Pose2, Scan
from pfcli.formats.log_writer import LogWriter

Cli = Callable[..., "subprocess.CompletedProcess[str]"]
Sample = Callable[[str], Path]
RUN = [sys.executable, "-c", "from pfcli.cli.app import run; run()"]
KILLS = [1, pytest.param(50, marks=pytest.mark.slow)]


def _carmen(path: Path, count: int) -> Path:
    rows = [f"FLASER 5 1 2 3 2 1 {0.1 * k:.2f} 0 0 {0.1 * k:.2f} 0 0 {k / 10} host {k / 10}\n" for k in range(count)]
    path.write_text("".join(rows))
    return path


def _content(place: Path) -> dict[str, bytes]:
    """Every file of an output but the one that has wall-clock in it."""
    files = [place] if place.is_file() else sorted(place.iterdir())
    return {file.name: file.read_bytes() for file in files if file.name != "run.json"}


def _commands(sample: Sample, folder: Path) -> dict[str, tuple[list[object], Path]]:
    """Words of a command and the output that it makes."""
    folder.mkdir(exist_ok=True)
    log = _carmen(folder / "a.log", 3000)
    grid = sample("four-rooms").with_suffix(".yaml")
    cache = cache_root() / "range-tables"
    return {
        "slam-gdr": (["slam-gdr", sample("small-loop"), "--end", "40", "--out", folder / "o"], folder / "o"),
        "convert": (["convert", log, folder / "a.mcap"], folder / "a.mcap"),
        "table": (["table", grid, "--bins", "73"], cache),
    }


@pytest.mark.parametrize("kills", KILLS)
@pytest.mark.parametrize("name", ["slam-gdr", "convert", "table"])
def test_killed_at_any_moment_an_output_is_whole_or_not_there(
    name: str, kills: int, sample: Sample, tmp_path: Path
) -> None:
    words, made = _commands(sample, tmp_path / "a")[name]
    tables = set(made.glob("[!.]*-73-*.ranges")) if name == "table" else set()
    for table in tables:
        table.unlink()
    warm = [*map(str, words), *(["--bins", "74"] if name == "table" else [])]  # compiles kernels, which must not count
    subprocess.run([*RUN, *warm], check=True, capture_output=True)
    again = [] if name == "table" else ["--force"]
    began = time.perf_counter()
    subprocess.run([*RUN, *map(str, words), *again], check=True, capture_output=True)
    seconds = time.perf_counter() - began
    reference = _content(next(made.glob("[!.]*-73-*.ranges")) if name == "table" else made)
    moments, whole = np.random.default_rng(5).uniform(0.0, 1.05 * seconds, kills), 0
    for moment in moments:
        words, made = _commands(sample, tmp_path / "k")[name]
        if name != "table":
            words = [*words, "--force"]
            shutil.rmtree(made) if made.is_dir() else made.unlink(missing_ok=True)
        for table in made.glob("[!.]*-73-*.ranges") if name == "table" else ():
            table.unlink()
        process = subprocess.Popen([*RUN, *map(str, words)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(moment)
        process.send_signal(signal.SIGKILL)
        process.wait()
        output = next(made.glob("[!.]*-73-*.ranges"), None) if name == "table" else made
        if output is not None and output.exists():
            assert _content(output) == reference, moment
            whole += 1
    again = subprocess.run([*RUN, *map(str, words)], capture_output=True, text=True)
    assert again.returncode == 0, again.stderr
    assert _content(next(made.glob("[!.]*-73-*.ranges")) if name == "table" else made) == reference
    assert whole < kills or kills < 10
    assert not list(made.parent.glob(".*.part*")), "what the killed ones left is swept away by the next"


_LIMIT = (
    "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000)); from pfcli.cli.app import run; run()"
)
"""No file may become larger: a write beyond fails as on a full disk."""


@pytest.mark.parametrize("name", ["convert", "repair", "plot"])
def test_a_disk_that_fills_up_leaves_nothing(name: str, sample: Sample, tmp_path: Path) -> None:
    source = sample("four-rooms")

    def words(out: Path) -> list[str]:
        out.mkdir()
        found: dict[str, list[object]] = {
            "convert": ["convert", _carmen(tmp_path / "a.log", 3000), out / "a.mcap"],
            "repair": ["repair", source, out / "a.mcap"],
            "plot": ["slam-gdr", sample("small-loop"), "--end", "3", "--out", out / "o", "--plot", out / "p.png"],
        }
        return [str(word) for word in found[name]]

    if name != "convert":  # kernels are in their cache, or they would be what does not fit
        subprocess.run([*RUN, *words(tmp_path / "warm")], check=True, capture_output=True)
    out = tmp_path / "new"
    env = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}  # the interpreter does not notice that its own files are cut
    limited = [sys.executable, "-c", _LIMIT, *words(out)]
    done = subprocess.run(limited, capture_output=True, text=True, env=env)
    assert done.returncode == 1, done.stdout
    assert done.stderr.count("\n") == 1
    assert "cannot be written" in done.stderr
    assert "File too large" in done.stderr
    assert list(out.iterdir()) == []


def test_links_and_folders_are_no_outputs(pfcli: Cli, sample: Sample, tmp_path: Path) -> None:
    """What a link points to was not named: it is neither followed nor replaced."""
    mine = tmp_path / "mine.txt"
    mine.write_text("keep")
    link = tmp_path / "link.mcap"
    link.symlink_to(mine)
    (tmp_path / "folder.mcap").mkdir()
    os.mkfifo(tmp_path / "pipe.mcap")
    for words in (
        ["repair", sample("four-rooms"), link, "--force"],
        ["convert", _carmen(tmp_path / "a.log", 10), link, "--force"],
        ["slam-gdr", sample("small-loop"), "--out", link, "--force"],
        ["slam-gdr", sample("small-loop"), "--out", tmp_path / "o", "--plot", mine / "x.png"],
        ["repair", sample("four-rooms"), tmp_path / "folder.mcap", "--force"],
        ["repair", sample("four-rooms"), "/proc/x.mcap"],
        ["repair", sample("four-rooms"), tmp_path / "pipe.mcap", "--force"],
    ):
        done = pfcli(*words)
        assert done.returncode == 1, (words, done.stdout)
        assert done.stderr.count("\n") == 1, done.stderr
    assert mine.read_text() == "keep"
    assert link.is_symlink()


def test_names_with_control_characters_stay_on_one_line(pfcli: Cli, tmp_path: Path) -> None:
    path = tmp_path / "a\n\x1b[31mb.mcap"
    with LogWriter(path) as log:
        log.odometry(Odometry(1, 0.0, 0.0, 0.0), "/od\x07om\nx")
        log.scan(Scan(1, np.ones(3, np.float32), 0.0, 0.1, 0.0, 9.0, Pose2()), "/\x1b]0;title\x07", "las\ner")
    for words in (
        ["info", path],
        ["slam-gdr", path, "--out", tmp_path / "o"],
        ["repair", path, tmp_path / "\x1b[2Jo.mcap"],
    ):
        done = pfcli(*words)
        text = done.stdout + done.stderr
        assert all(c.isprintable() or c == "\n" for c in text), text
        assert "\\x1b" in text
    found = json.loads(pfcli("info", "--json", path).stdout)
    assert found["messages"] == 2


def test_repair_says_what_is_lost_and_pipes(pfcli: Cli, sample: Sample, tmp_path: Path) -> None:
    data = sample("no-ros").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: 2 * len(data) // 3])
    done = pfcli("repair", tmp_path / "cut.mcap", tmp_path / "whole.mcap", "--json")
    assert done.returncode == 3
    assert "is cut off at byte" in done.stderr
    found = json.loads(done.stdout)
    again = pfcli("info", "--json", tmp_path / "whole.mcap")
    assert again.returncode == 0
    assert json.loads(again.stdout)["messages"] == found["messages"] > 100
    piped = subprocess.run([*RUN, "repair", "-", "-"], input=(tmp_path / "cut.mcap").read_bytes(), capture_output=True)
    assert piped.returncode == 3
    assert piped.stdout == (tmp_path / "whole.mcap").read_bytes()
    assert pfcli("repair", tmp_path / "cut.mcap", tmp_path / "whole.mcap").returncode == 2


def test_an_old_result_survives_a_kill_between_two_renames(tmp_path: Path) -> None:
    """With --force the old folder is moved aside for a moment; whoever comes next puts it back."""
    from pfcli.formats.atomic import _beside, check

    (tmp_path / "o").mkdir()
    (tmp_path / "o/mine.txt").write_text("keep")
    aside = _beside(tmp_path / "o", "old")
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    os.rename(tmp_path / "o", aside.with_name(aside.name.replace(str(os.getpid()), str(dead.pid))))
    check(tmp_path / "o", force=True)
    assert [p.name for p in tmp_path.iterdir()] == ["o"]
    assert (tmp_path / "o/mine.txt").read_text() == "keep"


def test_a_log_is_not_replaced_by_what_can_be_read_of_it(pfcli: Cli, sample: Sample, tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(sample("four-rooms").read_bytes()[:50_000])
    done = pfcli("repair", path, path, "--force")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert path.stat().st_size == 50_000
