"""Logs of wheel ticks: what is read, what is counted as unreadable."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from pfcli.errors import LogError
from pfcli.events import Scan, Ticks, Truth
from pfcli.formats import tick_logs


def _line(before: int, ticks: tuple[int, int], at: int) -> str:
    head = ["0"] * before
    head[0] = "1000"
    head[at], head[at + 1] = str(ticks[0]), str(ticks[1])
    return " ".join([*head, *["0", "1500"] * 341]) + "\n"


@pytest.mark.parametrize(("before", "at", "right"), [(24, 2, 20), (13, 1, -20)])
def test_both_layouts_of_tinyslam(before: int, at: int, right: int, tmp_path: Path) -> None:
    path = tmp_path / "x.dat.gz"
    path.write_bytes(gzip.compress((_line(before, (10, 20), at) + "1 2 3\n").encode()))
    reader = tick_logs.reader_of(path)
    assert reader is not None
    log = reader(path)
    ticks, scan = log.events
    assert isinstance(ticks, Ticks)
    assert isinstance(scan, Scan)
    assert ticks.ticks.tolist() == [10, right]
    assert (ticks.stamp_ns, log.broken) == (1_000_000, 1)
    assert np.isinf(scan.ranges_m[0])
    assert scan.ranges_m[1] == pytest.approx(1.5)
    assert scan.angle_min_rad == pytest.approx(-np.radians(119.7), abs=2e-3)


def test_the_lego_folder(tmp_path: Path) -> None:
    (tmp_path / "r_motors.txt").write_text("M 20 7 7 0 0 9 9\nM x\n")
    (tmp_path / "r_scan.txt").write_text("S 10 3 500 0 700\nS 30 9 1 2 3\n")
    reader = tick_logs.reader_of(tmp_path)
    assert reader is not None
    log = reader(tmp_path)
    assert [e.stamp_ns for e in log.events] == [10_000_000, 20_000_000]
    assert isinstance(log.events[1], Ticks)
    assert log.events[1].ticks.tolist() == [7, 9]
    assert log.broken == 2


def test_the_tricycle_with_its_wrapping_counter(tmp_path: Path) -> None:
    path = tmp_path / "dataset.txt"
    path.write_text(
        "#kinematic_model: traction_drive_wheel\n#joints_max_enc_values: 8192 5000 \n"
        "time: 5.000000007 ticks: 290 4294967290 model_pose: 0 0 0 tracker_pose: 1 2 0.5\n"
    )
    reader = tick_logs.reader_of(path)
    assert reader is not None
    ticks, truth = reader(path).events
    assert isinstance(ticks, Ticks)
    assert ticks.ticks.tolist() == [290, 4294967290]
    assert truth == Truth(5_000_000_007, 1.0, 2.0, 0.5)


def test_files_without_ticks_are_refused_with_their_name(tmp_path: Path) -> None:
    path = tmp_path / "x.dat"
    path.write_text("nothing here\n")
    with pytest.raises(LogError, match=r"x\.dat: holds no line with wheel ticks"):
        tick_logs.tinyslam(path)
    with pytest.raises(LogError, match="_motors"):
        tick_logs.lego(tmp_path)


@pytest.mark.parametrize(
    ("kind", "turn", "ticks"),
    [("omni3", "12,1024", [3, -12, -1]), ("omni4", "1,1", [-3 * 65536, -12 * 65536, 65536, 0])],
)
def test_optiodom_with_its_signs_and_units(kind: str, turn: str, ticks: list[int], tmp_path: Path) -> None:
    gear, resolution = turn.split(",")
    (tmp_path / "7_metadata.csv").write_text(
        f"\ufefftype,{kind},,,\nngear,{gear},,,\nencRes,{resolution},,,\nLi,0.2,0.21,,\nDi,0.1,0.1,0.1,\n"
    )
    more = ",-0" if kind == "omni4" else ""
    path = tmp_path / "7_run-01.csv"
    path.write_text(f"\ufeff0,0,0,0,0,0,0{more}\n0.04,0.1,0.2,0.3,-3,12,1{more}\nx\n")
    reader = tick_logs.reader_of(path)
    assert reader is not None
    log = reader(path)
    last, truth = log.events[-2:]
    assert isinstance(last, Ticks)
    assert isinstance(truth, Truth)
    assert last.ticks.tolist() == ticks
    assert last.cumulative
    assert last.ticks_per_turn == (12288.0 if kind == "omni3" else 65536.0)
    assert tuple(truth[1:4]) == (0.1, 0.2, 0.3)
    assert log.broken == 1
    assert "--wheel-radius-m 0.05" in log.hint


def test_optiodom_without_what_is_needed_names_the_metadata(tmp_path: Path) -> None:
    (tmp_path / "7_metadata.csv").write_text("type,tricyc\n")
    path = tmp_path / "7_run-01.csv"
    path.write_text("0,0,0,0,0\n")
    with pytest.raises(LogError, match=r"7_metadata\.csv.*omni3"):
        tick_logs.optiodom(path)
