"""The recorded logs, where they are there: conversion against known facts, and the figures of the benchmark at one seed."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import needs

pytestmark = [pytest.mark.real, pytest.mark.xdist_group("real")]
Cli = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def intel(pfcli: Cli, tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = needs("intel/intel.clf.bz2")
    path = tmp_path_factory.mktemp("intel") / "intel.mcap"
    done = pfcli("convert", data / "intel/intel.clf.bz2", path, "--json")
    found = json.loads(done.stdout)
    # facts of the recording: scans, the no-return value 81.83, about 9 % broken stamps, one backward step after the repair
    assert (found["scans"], found["backward_steps"]) == (13631, 1)
    assert found["range_max_m"] == pytest.approx(0.99 * 81.83, abs=1e-3)
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


def test_raw_odometry_on_intel_reads_what_is_known(intel: Path, pfcli: Cli, tmp_path: Path) -> None:
    """7.37 m over all relations: checks the evaluation itself."""
    data = needs("intel/intel.relations")
    import numpy as np

    from pfcli.formats import tum
    from pfcli.replay import Log

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
