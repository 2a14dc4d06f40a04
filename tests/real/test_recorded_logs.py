"""The recorded logs, where they are there: conversion against known facts, and the figures of the benchmark at one seed."""

import json
import math
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import needs

pytestmark = pytest.mark.real
Cli = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def intel(pfcli: Cli, tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = needs("intel/intel.clf.bz2")
    path = tmp_path_factory.mktemp("intel") / "intel.mcap"
    done = pfcli("convert", data / "intel/intel.clf.bz2", path, "--json")
    found = json.loads(done.stdout)
    # facts of the recording: scans, the no-return value 81.83, about 9 % broken stamps, one backward step after the repair
    assert (found["scans"], found["backward_steps"]) == (13631, 1)
    assert found["range_max_m"] == pytest.approx(81.83 - 1e-3, abs=1e-4)  # just below the value that is repeated
    assert 0.08 < found["repaired_stamps"] / found["odometry"] < 0.11
    return path


def test_intel_relations(intel: Path, pfcli: Cli, tmp_path: Path) -> None:
    data = needs("intel/intel.relations")
    assert pfcli("slam-gdr", intel, "--out", tmp_path / "o").returncode == 0
    done = pfcli("evaluate", tmp_path / "o/track.tum", "--relations", data / "intel/intel.relations", "--json")
    found = json.loads(done.stdout)["relations"]
    assert found["missing"] == 0
    assert (found["all"]["translation_m"]["n"], found["far"]["translation_m"]["n"]) == (2984, 1212)
    assert found["far"]["translation_m"]["mean"] <= 0.027
    assert found["all"]["translation_m"]["mean"] <= 0.021


def test_wean_hall_ends_where_independent_filters_agree_that_it_ends(pfcli: Cli, tmp_path: Path) -> None:
    """Map and log are independent; 6 m of the hall have changed, and other corridors look like it."""
    data, log = needs("wean/robotdata3.log.gz"), tmp_path / "wean.mcap"
    assert pfcli("convert", data / "wean/robotdata3.log.gz", log).returncode == 0
    for seed in range(3):
        words = ["localize-partial", log, "--map", data / "wean/wean.yaml", "--initial", "inside", "--seed", seed]
        assert pfcli(*words, "--out", tmp_path / f"run{seed}").returncode == 0
        x, y, *_, qz, qw = map(float, (tmp_path / f"run{seed}/track.tum").read_text().splitlines()[-1].split()[1:])
        assert math.hypot(x - 39.78, y - 39.81) <= 0.3
        assert abs(2 * math.atan2(qz, qw) + 0.03) <= math.radians(5)


def test_raw_odometry_on_intel_reads_what_is_known(intel: Path, pfcli: Cli, tmp_path: Path) -> None:
    """7.37 m over all relations: checks the evaluation itself."""
    data = needs("intel/intel.relations")
    import numpy as np

    from pfcli.formats import tum
    from pfcli.replay.log import Log

    poses = {e.stamp_ns: e[1:4] for e in Log(intel).events(["odometry"])}
    stamps = [e.stamp_ns for e in Log(intel).events(["scan"])]
    tum.write(tmp_path / "odom.tum", np.array(stamps), np.array([poses[s] for s in stamps]))
    done = pfcli(
        "evaluate", tmp_path / "odom.tum", "--relations", data / "intel/intel.relations", "--stamps", intel, "--json"
    )
    assert json.loads(done.stdout)["relations"]["all"]["translation_m"]["mean"] == pytest.approx(7.37, abs=0.02)


def test_ros1_bags_are_read(pfcli: Cli, tmp_path: Path) -> None:
    data = needs("polimi-mecanum/bag1.bag")
    done = pfcli("convert", data / "polimi-mecanum/bag1.bag", tmp_path / "x.mcap", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(pfcli("info", tmp_path / "x.mcap", "--json").stdout)
    types = {t["type"]: t for t in found["topics"]}
    assert types["sensor_msgs/msg/JointState"]["rate_hz"] == pytest.approx(49, abs=2)


def test_wheels_of_a_real_robot_calibrated_on_one_half_reckon_the_other(pfcli: Cli, tmp_path: Path) -> None:
    """PoliMi's mecanum robot: 0.12-0.18 m of mean error by the nominal radii, at most 0.10 m for the mean of both ways."""
    from pfcli.cli.commands.calibrate_omni import rolled_of_log
    from pfcli.dropped import Dropped
    from pfcli.replay.log import Log
    from pfcli.replay.settings import Drive, Settings
    from pfcli.systems.fuse_soccer import base_calibration

    bag = needs("polimi-mecanum/bag1.bag") / "polimi-mecanum/bag1.bag"
    log = tmp_path / "polimi.mcap"
    assert pfcli("convert", bag, log).returncode == 0
    drive = Drive("mecanum", None, (0.07,), track_m=0.338, axles_m=0.4, ticks_per_turn=42 * 5)
    reading = Settings(topics={"truth": "/robot/pose"})
    halves = [
        rolled_of_log(Log(log, reading._replace(**cut)), drive, Dropped())
        for cut in ({"end_s": 29.4}, {"start_s": 29.4})
    ]
    errors = []
    for k in (0, 1):
        fit = base_calibration.fit_wheels([halves[k]], drive)
        errors.append(base_calibration.error_m(halves[1 - k], fit)[0])
        assert all(0.07 * 0.9 < r < 0.078 * 1.1 for r in fit.drive.radius_m)
    assert sum(errors) / 2 < 0.10


def test_a_real_frame_of_lines_gives_the_known_pose_or_its_mirror_image(pfcli: Cli, tmp_path: Path) -> None:
    """The Falcons' frame: within 0.2 m of their solver's pose; which side cannot be seen."""
    import pyarrow.parquet as pq

    folder = needs("soccer-lines/falcons_r5") / "soccer-lines/falcons_r5"
    log = tmp_path / "frame.mcap"
    assert pfcli("convert", next(folder.glob("test3*.json")), log).returncode == 0
    assert pfcli("fuse-soccer", log, "--max-range-m", 9, "--out", tmp_path / "run").returncode == 0
    track = pq.read_table(tmp_path / "run/track.parquet").to_pydict()
    known = (3.004, -0.596)
    off = [
        math.hypot(track[a][0] - known[0], track[b][0] - known[1])
        for a, b in (("x_m", "y_m"), ("mirror_x_m", "mirror_y_m"))
    ]
    assert min(off) < 0.2
    assert track["mirror_p"][0] == pytest.approx(0.5)
