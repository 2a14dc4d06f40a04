"""`pfcli calibrate-drive`."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


def test_wheels_and_laser_are_found_without_truth(sample: Callable[[str], Path], pfcli: Any, tmp_path: Path) -> None:
    """70 s of the sample, given wheels 4 %, a track 10 % and a mount 0.13 m and 6 deg off, and a clock 0.1 s off."""
    wrong = ["--wheel-radius-m", "0.104", "--track-width-m", "0.30", "--extrinsic", "base_link:laser=0.2,0.1,0.1"]
    out = tmp_path / "drive.toml"
    done = pfcli("calibrate-drive", sample("four-rooms"), *wrong, "--time-offset", "scan=0.1", "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    true = {
        "wheel_radius_left_m": 0.1 / 0.998,
        "wheel_radius_right_m": 0.1 / 1.001,
        "track_width_m": 0.33,
        "sensor_x_m": 0.12,
        "sensor_y_m": 0.0,
        "sensor_yaw_deg": 0.0,
        "offset_s": -0.1,
    }
    for name, value in true.items():
        assert found[name] == pytest.approx(value, abs=4 * found[f"{name}_sd"]), name
    assert found["sensor_x_m_sd"] < 0.005
    assert tomllib.loads(out.read_text())["track_width_m"] == found["track_width_m"]


def test_what_is_missing_is_said(sample: Callable[[str], Path], pfcli: Any) -> None:
    done = pfcli("calibrate-drive", sample("landmarks"))
    assert done.returncode == 2
    assert "needs laser scans; --topic scan=TOPIC, or --truth" in done.stderr
    done = pfcli("calibrate-drive", sample("four-rooms"))
    assert "--wheel-radius-m and --track-width-m" in done.stderr
