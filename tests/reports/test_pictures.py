"""Pictures, films, overlays and comparisons: they are there, they repeat, and others can read them."""

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from PIL import Image

from pfcli.errors import UsageError
from pfcli.reports import animation, overlay, run_picture
from tests.reports.runs import done, short_run

Cli = Callable[..., "subprocess.CompletedProcess[str]"]
RERUN = shutil.which("rerun")


@pytest.mark.parametrize("ending", ["svg", "pdf", "png"])
def test_a_picture_repeats_byte_for_byte(ending: str, tmp_path: Path) -> None:
    job, run = done("slam-gdr")
    for name in "ab":
        run_picture.write(tmp_path / f"{name}.{ending}", job, run)
    a, b = ((tmp_path / f"{name}.{ending}").read_bytes() for name in "ab")
    assert a == b
    assert len(a) > 5000


def test_a_picture_shows_truth_odometry_confidence_and_a_scale(tmp_path: Path) -> None:
    job, run = done("localize-reliable")
    run_picture.write(tmp_path / "a.svg", job, run)
    shown = run_picture.drawn(job, run)
    assert shown.confidence is not None
    assert shown.truth is not None
    assert np.nanmax(np.hypot(*(shown.truth - shown.poses[:, :2]).T) - run.errors.position_m) < 1e-9  # type: ignore[union-attr]
    assert shown.odometry is not None
    first = int(np.argmax(np.isfinite(shown.poses).all(axis=1)))
    assert np.allclose(shown.odometry[first], shown.poses[first])
    assert shown.title.startswith("localize-reliable: kidnapped.mcap")


def test_a_pose_that_moves_farther_than_the_wheels_is_a_jump_and_no_line(tmp_path: Path) -> None:
    job, run = done("slam-gdr")
    poses = run.result.track.poses.copy()
    poses[len(poses) // 2 :, 0] += 3.0
    poses[3] = np.nan
    result = run.result._replace(track=run.result.track._replace(poses=poses))
    assert np.flatnonzero(run_picture.drawn(job, run).jumps).size == 0
    assert np.flatnonzero(run_picture.drawn(job, run._replace(result=result)).jumps).tolist() == [
        2,
        3,
        len(poses) // 2 - 1,
    ]


def test_a_film_shows_the_particles_gather(tmp_path: Path) -> None:
    result = done("localize-lookup")[1].result
    animation.animate(tmp_path / "a.gif", result, "four rooms")
    with Image.open(tmp_path / "a.gif") as film:
        assert film.n_frames == len(result.frames) > 5  # type: ignore[attr-defined]
        first = film.convert("RGB").tobytes()
        film.seek(film.n_frames - 1)  # type: ignore[attr-defined]
        assert film.convert("RGB").tobytes() != first


def test_a_sheet_shows_eight_instants_and_repeats(tmp_path: Path) -> None:
    result = done("localize-partial")[1].result
    for name in "ab":
        animation.animate(tmp_path / f"{name}.svg", result, "in and out")
    text = (tmp_path / "a.svg").read_text()
    assert text == (tmp_path / "b.svg").read_text()
    assert [f'id="axes_{k}"' in text for k in (1, 8, 9)] == [True, True, False]
    short = result._replace(frames=result.frames[:3])
    animation.animate(tmp_path / "c.png", short, "three")
    with Image.open(tmp_path / "c.png") as sheet:
        assert sheet.width > 1000


def test_a_film_that_cannot_be_made_is_refused_before_any_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UsageError, match="ffmpeg"):
        animation.check(tmp_path / "a.mp4")
    with pytest.raises(UsageError, match="ending"):
        animation.check(tmp_path / "a.avi")


TOPICS = {
    "slam-gdr-landmarks": {"/pfcli/landmarks", "/pfcli/pose", "/pfcli/particles", "/tf"},
    "localize-reliable": {"/pfcli/map", "/pfcli/unknown_obstacles", "/pfcli/pose", "/pfcli/particles", "/tf"},
    "fuse-soccer": {"/pfcli/map", "/pfcli/pose", "/pfcli/particles", "/tf"},
}


@pytest.mark.parametrize("name", sorted(TOPICS))
def test_an_overlay_can_be_read_by_others(name: str, tmp_path: Path) -> None:
    """By the mcap package, and by Rerun, which checks every topic and understands maps and transforms."""
    path = tmp_path / "overlay.mcap"
    overlay.write(path, done(name)[1].result)
    with open(path, "rb") as file:
        reader = make_reader(file)
        assert {channel.topic for _, channel, _ in reader.iter_messages()} == TOPICS[name]
    if RERUN is None:
        pytest.skip("no rerun on the path; it is in the extra `test`")
    env = os.environ | {"HOME": str(tmp_path)}
    subprocess.run([RERUN, "analytics", "disable"], env=env, capture_output=True, check=False)
    checked = subprocess.run([RERUN, "mcap", "check", str(path)], env=env, capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stderr
    rows = [line.split() for line in (checked.stdout + checked.stderr).splitlines()]
    assert {row[3] for row in rows if row[:1] == ["ok"]} == TOPICS[name]


def test_runs_are_compared_and_what_differs_is_named(pfcli: Cli, tmp_path: Path) -> None:
    # of the filter alone: smoothed tracks of two seeds are the same
    a = short_run("slam-gdr", tmp_path / "a", smooth=False)
    b = short_run("slam-gdr", tmp_path / "b", seed=1, particles=4, smooth=False)
    c = pfcli("compare", a, b, "--json", "--plot", tmp_path / "both.svg")
    assert c.returncode == 0, c.stderr
    found = json.loads(c.stdout)
    assert found["differences"] == {"particles": [10, 4]}
    assert [row["seed"] for row in found["runs"]] == [0, 1]
    assert found["runs"][0]["apart_m"] == 0.0
    assert 0.0 < found["runs"][1]["apart_m"] < 0.05
    assert (tmp_path / "both.svg").stat().st_size > 5000
    table = pfcli("compare", a, b).stdout
    assert "what differs" in table
    assert pfcli("compare", a).returncode == 2
    assert pfcli("compare", a, tmp_path).returncode == 1


def test_options_stand_in_groups_and_shells_complete(pfcli: Cli) -> None:
    text = pfcli("slam-gdr", "--help-all").stdout
    order = [
        text.index(word) for word in ("\nInput:", "--topic", "\nFilter:", "--particles", "\nOutput:", "--out PATH")
    ]
    assert order == sorted(order)
    for shell in ("bash", "zsh", "fish"):
        env = os.environ | {"_PFCLI_COMPLETE": f"{shell}_source"}
        assert "_PFCLI_COMPLETE" in pfcli(env=env).stdout
    env = os.environ | {"_PFCLI_COMPLETE": "bash_complete", "COMP_WORDS": "pfcli slam", "COMP_CWORD": "1"}
    assert pfcli(env=env).stdout.split() == ["plain,slam-gdr"]
