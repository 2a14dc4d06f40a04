"""fuse-soccer and calibrate-omni in real subprocesses: what they write, and one line for what is wrong."""

import json
import math
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from pfcli.events import Heading, LinePoints, Odometry, Ticks
from pfcli.formats.log_writer import LogWriter
from pfcli.simulation import soccer_world

Cli = Callable[..., "subprocess.CompletedProcess[str]"]
Sample = Callable[[str], Path]
SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
DRIVE = ["--drive", SAMPLES / "soccer.toml"]
WHEELS = ["--base", "omni", "--wheel-radius-m", "0.06", "--wheel-arm-m", "0.203"]
T0 = 1_700_000_000 * 10**9
POSE = np.array([3.0, 1.0, 0.4])


def _one_line(done: "subprocess.CompletedProcess[str]", code: int, *words: str) -> None:
    assert done.returncode == code, (done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    for word in words:
        assert word in done.stderr, done.stderr


def _match(path: Path, frames: int = 8, **put: Any) -> Path:
    """A robot that stands still at POSE. put: what each frame writes instead of points in metres and a heading."""
    vision = soccer_world.Vision(
        soccer_world.SCENARIOS["soccer-route-1"]._replace(point_noise=0.01), np.random.default_rng(0)
    )
    with LogWriter(path) as log:
        for k in range(frames):
            t = T0 + k * 100_000_000
            log.odometry(Odometry(t, 0.0, 0.0, 0.0))
            points = vision.points(POSE)
            if "pixels" in put:
                px = [[320.0 - 2.86 * 10 * y, 240.0 - 2.86 * 10 * x] for x, y in points.tolist()]
                log.json("/lines", "pfcli.LinePoints", t, points_px=px)
            else:
                log.line_points(LinePoints(t, points))
            if "field_t" in put:
                from pfcli.formats.message_writer import header
                from pfcli.formats.schemas import typestore

                types = typestore().types
                x, y = put["field_t"]
                vector = types["geometry_msgs/msg/Vector3"](x, y, 0.0)
                kind = "sensor_msgs/msg/MagneticField"
                log.message("/mag", kind, t, types[kind](header(t, "base_link"), vector, np.zeros(9)))
            else:
                log.heading(Heading(t, float(POSE[2]), math.nan))
    return path


def test_the_sample_gives_a_track_with_its_mirror_image_and_rows_of_every_sensor(
    pfcli: Cli, sample: Sample, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    done = pfcli("fuse-soccer", sample("soccer"), *DRIVE, "--out", out, "--truth", "auto", "--json")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["truth"]["mean_m"] < 0.08
    assert summary["truth"]["max_m"] < 0.35
    track, rows = (pq.read_table(out / f"{name}.parquet").to_pydict() for name in ("track", "metrics"))
    assert {"mirror_p", "mirror_x_m", "error_m"} <= set(track)
    wanted = {
        "compass_residual_rad",
        "compass_disturbed",
        "slip_m",
        "points",
        "landmarks",
        "injected",
        "modes",
        "n_eff",
    }
    assert wanted <= set(rows)
    assert any(rows["compass_disturbed"])
    evaluated = pfcli("evaluate", out / "track.tum", "--truth", sample("soccer"), "--json")
    assert json.loads(evaluated.stdout)["truth"]["mean_m"] < 0.1


def test_pixels_become_metres_with_a_scale_and_are_refused_without(pfcli: Cli, tmp_path: Path) -> None:
    log = _match(tmp_path / "px.mcap", pixels=True)
    _one_line(pfcli("fuse-soccer", log, "--out", tmp_path / "a"), 2, "/lines", "--px-per-cm", "--image-centre")
    scale = ["--px-per-cm", "0.286", "--image-centre", "320,240"]
    done = pfcli("fuse-soccer", log, "--out", tmp_path / "b", *scale)
    assert done.returncode == 0, done.stderr
    x, y, yaw = (pq.read_table(tmp_path / "b/track.parquet")[k][-1].as_py() for k in ("x_m", "y_m", "yaw_rad"))
    assert math.hypot(x - POSE[0], y - POSE[1]) < 0.1
    assert yaw == pytest.approx(POSE[2], abs=0.05)


def test_a_magnetic_field_decides_the_side_and_one_of_nan_is_counted(pfcli: Cli, tmp_path: Path) -> None:
    north = math.pi / 2 - float(POSE[2])
    log = _match(tmp_path / "mag.mcap", frames=30, field_t=(2e-5 * math.cos(north), 2e-5 * math.sin(north)))
    done = pfcli("fuse-soccer", log, "--out", tmp_path / "a", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["mirror_p_at_end"] < 0.1
    bad = _match(tmp_path / "nan.mcap", field_t=(math.nan, math.nan))
    done = pfcli("fuse-soccer", bad, "--out", tmp_path / "b", "--json")
    assert done.returncode == 3
    assert "magnetic_field" in done.stderr
    assert json.loads(done.stdout)["mirror_p_at_end"] == 0.5


def test_frames_before_the_first_encoder_reading_are_counted(pfcli: Cli, tmp_path: Path) -> None:
    path, vision = (
        tmp_path / "early.mcap",
        soccer_world.Vision(soccer_world.SCENARIOS["soccer-route-1"], np.random.default_rng(0)),
    )
    with LogWriter(path) as log:
        for k in range(10):
            t = T0 + k * 100_000_000
            log.line_points(LinePoints(t, vision.points(POSE)))
            if k > 3:
                log.ticks(Ticks(t, soccer_world.JOINTS, np.zeros(4, np.int64), 8192.0, True))
    done = pfcli("fuse-soccer", path, *DRIVE, "--out", tmp_path / "a", "--json")
    assert done.returncode == 3
    assert json.loads(done.stdout)["lost"] == {"sighting before odometry": 4}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], ["--wheel-radius-m", "--base"]),
        (["--base", "omni"], ["--wheel-arm-m", "--wheel-angle-deg"]),
        (WHEELS, ["--wheel-angle-deg"]),
        ([*WHEELS, *["--wheel-angle-deg", "45"] * 4], ["--wheel-angle-deg", "three different"]),
        (
            [*WHEELS, *(w for a in (45, 135, 225, 315) for w in ("--wheel-angle-deg", a))],
            ["which wheel is which", "--wheel-joints"],
        ),
        ([*WHEELS, "--wheel-angle-deg", "95"], ["--wheel-angle-deg"]),
        ([*WHEELS, "--wheel-angle-deg", "45", "--wheel-joints", "a,b,c,d"], ["no joint 'a'"]),
        ([*DRIVE, "--field", "nowhere"], ["msl-18x12"]),
        ([*DRIVE, "--initial", "40,0,0"], ["not on the field"]),
        ([*DRIVE, "--initial", "outside"], ["fuse-soccer"]),
        ([*DRIVE, "--sigma", "1:0.1,0:0.2"], ["ranges must grow"]),
        (["--drive", "no.toml"], ["no.toml"]),
    ],
)
def test_what_is_missing_or_wrong_is_one_line(
    words: list[Any], told: list[str], pfcli: Cli, sample: Sample, tmp_path: Path
) -> None:
    done = pfcli("fuse-soccer", sample("soccer"), "--out", tmp_path / "o", *words)
    _one_line(done, 1 if "no.toml" in words else 2, *told)
    assert not (tmp_path / "o").exists()


def test_a_drive_file_with_an_unknown_field_is_refused(pfcli: Cli, sample: Sample, tmp_path: Path) -> None:
    path = tmp_path / "d.toml"
    for text, told in (("base = 3\n", "base"), ("wheel_radius = 1\n", "wheel_radius"), ("a = [\n", "TOML")):
        path.write_text(text)
        _one_line(pfcli("fuse-soccer", sample("soccer"), "--drive", path, "--out", tmp_path / "o"), 2, told)


def test_calibration_writes_what_fuse_soccer_reads(pfcli: Cli, tmp_path: Path) -> None:
    """Wheels believed 5 % too small on a drive with little noise; points with the noise of eq. (10)."""
    log = tmp_path / "log.mcap"
    soccer_world.write(
        soccer_world.SCENARIOS["soccer-route-1"]._replace(shift_noise=0.02, turn_noise=0.02, false_share=0.1), 0, log
    )
    words = ["--base", "omni", "--wheel-radius-m", "0.057", "--wheel-arm-m", "0.203", "--wheel-angle-deg", "45"]
    done = pfcli("calibrate-omni", log, *words, "--out", tmp_path / "cal", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert np.allclose(found["drive"]["radius_m"], 0.06, rtol=0.01)
    errors = found["dead_reckoning"][str(log)]
    assert errors["after_mean_m"] < 0.3 * errors["before_mean_m"]
    pairs = dict(part.split(":") for part in found["sigma"].split(","))
    assert float(pairs["3.25"]) == pytest.approx(0.043 * 3.25, rel=0.2)
    assert pq.read_table(tmp_path / "cal/histograms.parquet").num_rows > 5
    given = ["--drive", tmp_path / "cal/drive.toml", "--params", tmp_path / "cal/params.toml"]
    ran = pfcli("fuse-soccer", log, *given, "--out", tmp_path / "run", "--truth", "auto", "--json")
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stdout)["truth"]["mean_m"] < 0.05


def test_calibration_without_truth_says_so(pfcli: Cli, sample: Sample, tmp_path: Path) -> None:
    log = _match(tmp_path / "no.mcap")
    _one_line(pfcli("calibrate-omni", log, *DRIVE, "--out", tmp_path / "c"), 2, "no encoders topic")
    assert not (tmp_path / "c").exists()
