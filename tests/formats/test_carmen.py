import bz2
import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from pfcli.errors import LogError
from pfcli.events import Pose2
from pfcli.formats import carmen

FLASER = "FLASER 3 1.0 2.0 81.83 1.25 2.0 0.0 1.0 2.0 0.0 12.040413 host 0.1\n"
ODOM = "ODOM 1.0 2.0 0.5 0.3 0.1 0 11.5 host 0.05\n"
ROBOTLASER = "ROBOTLASER1 0 -1.57 3.14 1.57 30.0 0.01 0 3 1 2 3 0 4.0 5.0 0.1 4.0 5.0 0.1 0.2 0.0 0 0 0 77.25 h 1\n"


@pytest.mark.parametrize("ending", ["log", "clf", "clf.gz", "log.bz2"])
def test_lines_are_read_from_every_wrapping(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"x.{ending}"
    data = (f"# comment\n{ODOM}{FLASER}{ROBOTLASER}").encode()
    path.write_bytes(
        gzip.compress(data) if ending.endswith("gz") else bz2.compress(data) if ending.endswith("bz2") else data
    )
    (odom, flaser, robot), broken = carmen.read(path)
    assert broken == 0
    assert (odom.odometry, odom.velocity, odom.stamp) == ((1.0, 2.0, 0.5), (0.3, 0.1), "11.5")
    assert flaser.stamp == "12.040413"
    assert flaser.mount == (0.25, 0.0, 0.0)
    assert flaser.angles == pytest.approx((-math.pi / 2, math.pi / 2))
    assert robot.stamp == "77.25"
    assert robot.ranges_m is not None
    assert robot.ranges_m.tolist() == [1, 2, 3]


@pytest.mark.parametrize(("beams", "step_deg"), [(180, 1.0), (360, 0.5), (361, 0.5), (181, 1.0)])
def test_flaser_angles_follow_the_beam_count(beams: int, step_deg: float, tmp_path: Path) -> None:
    line = f"FLASER {beams} {'1 ' * beams} 0 0 0 0 0 0 1.0 h 0\n"
    (tmp_path / "x.log").write_text(line)
    (record,), _ = carmen.read(tmp_path / "x.log")
    assert np.degrees(record.angles) == pytest.approx((-90.0, step_deg))


def test_the_no_return_value_is_found(tmp_path: Path) -> None:
    (tmp_path / "x.log").write_text(FLASER * 5)
    records, _ = carmen.read(tmp_path / "x.log")
    assert carmen.usable_range_m(records) == pytest.approx(81.829, abs=1e-4)
    (tmp_path / "y.log").write_text(FLASER)
    assert carmen.usable_range_m(carmen.read(tmp_path / "y.log")[0]) == pytest.approx(81.83, rel=1e-6)


def test_stamps_without_their_leading_zeros_are_repaired() -> None:
    true_us = [100 + k * 7_613 for k in range(400)]
    printed = [f"{us // 10**6}.{str(us % 10**6).ljust(6, '0')}" for us in true_us]
    stamps, repaired = carmen.stamps_ns(printed, repair=True)
    assert repaired > 0
    assert stamps[1:] == [us * 1000 for us in true_us[1:]]  # nothing stands in front of the first
    same, none = carmen.stamps_ns(printed, repair=False)
    assert none == 0
    assert same != stamps


def test_sound_stamps_are_left_alone() -> None:
    texts = [f"12.{k:06d}" for k in range(0, 900_000, 3100)]
    assert carmen.stamps_ns(texts, repair=True) == ([12 * 10**9 + k * 1000 for k in range(0, 900_000, 3100)], 0)


def test_unreadable_lines_are_counted_and_an_empty_log_refused(tmp_path: Path) -> None:
    (tmp_path / "x.log").write_text(FLASER + "FLASER 9 1 2\n" + ODOM)
    records, broken = carmen.read(tmp_path / "x.log")
    assert (len(records), broken) == (2, 1)
    (tmp_path / "y.log").write_text("nothing here\n")
    with pytest.raises(LogError, match="holds no ODOM"):
        carmen.read(tmp_path / "y.log")
    (tmp_path / "z.clf.bz2").write_bytes(b"not bzip2")
    with pytest.raises(LogError, match="cannot be read"):
        carmen.read(tmp_path / "z.clf.bz2")


def test_lines_in_centimetres_are_read_with_their_mount(tmp_path: Path) -> None:
    ranges = " ".join(["150"] * 179 + ["8183"])
    path = tmp_path / "bee.log"
    path.write_text(f"O 100.0 200.0 0.5 1.25\nL 100.0 200.0 0.0 125.0 200.0 0.0 {ranges} 1.5\nO 1 2\n")
    records, broken = carmen.read(path)
    assert broken == 1
    assert records[0].odometry == (1.0, 2.0, 0.5)
    assert records[0].stamp == "1.25"
    assert records[1].mount == Pose2(0.25, 0.0, 0.0)
    assert records[1].ranges_m is not None
    assert records[1].ranges_m[0] == pytest.approx(1.5)
    assert records[1].ranges_m[-1] == pytest.approx(81.83)
    assert records[1].angles == pytest.approx((-np.pi / 2, np.pi / 180))
