"""Several scanners as one."""

import math
from pathlib import Path

import numpy as np
import pytest

from pfcli.core import rigid
from pfcli.dropped import Dropped
from pfcli.errors import UsageError
from pfcli.events import Scan, Sweep
from pfcli.formats.log_writer import LogWriter
from pfcli.replay.align import sweeps
from pfcli.replay.log import Log
from pfcli.replay.scanners import together
from pfcli.replay.settings import Drive, Settings
from tests.replay.frames import robot_log as r
from tests.replay.frames.robot_log import motion_at, walls_off

FRONT = rigid.from_euler((0.3, 0.1, 0.2), 0.0, 0.0, 0.5)
REAR = rigid.from_euler((-0.3, -0.1, 0.2), math.pi, 0.0, math.pi)


def drive(path: Path, late: int = 0, missing: int = -1) -> Path:
    """Two scanners at 10 Hz, the rear one `late` tenths behind and silent once."""
    with LogWriter(path) as log:
        r.tf(log, "/tf_static", 0, [("base_link", "front", FRONT), ("base_link", "rear", REAR)])
        for k in range(12):
            r.odometry(log, k, motion_at(k))
            if k % 2 == 0:
                r.scan(log, k, FRONT, "front", "/front")
            if k % 2 == late and k != missing:
                r.scan(log, k, REAR, "rear", "/rear")
    return path


def rounds(path: Path) -> list[Sweep]:
    log = Log(path, Settings(topics={"scan": "/front,/rear"}))
    single = sweeps(log.events(["odometry", "scan"]), "odometry", Drive(), Dropped())
    return [s for s in together(single, 2, Dropped()) if isinstance(s, Sweep)]


@pytest.mark.parametrize("late", [0, 1])
def test_a_round_is_one_scan_of_what_both_see(late: int, tmp_path: Path) -> None:
    found = rounds(drive(tmp_path / "x.mcap", late))
    assert len(found) == 6
    for k, sweep in enumerate(found):
        at = 2 * k + late
        assert sweep.stamp_ns == r.T0 + at * r.S // 10
        assert sweep.scan.ranges_m.size == 2 * r.ANGLES.size
        assert (np.diff(sweep.scan.bearings_rad) >= 0).all()
        assert walls_off(sweep.scan, at) < 1e-4


def test_a_scanner_that_misses_a_turn_holds_nobody_up(tmp_path: Path) -> None:
    sizes = [sweep.scan.ranges_m.size // r.ANGLES.size for sweep in rounds(drive(tmp_path / "x.mcap", 1, missing=5))]
    assert sizes == [2, 2, 1, 2, 2, 2]


def test_one_scanner_passes_untouched(tmp_path: Path) -> None:
    log = Log(drive(tmp_path / "x.mcap"), Settings(topics={"scan": "/rear"}))
    single = list(sweeps(log.events(["odometry", "scan"]), "odometry", Drive(), Dropped()))
    assert list(together(single, 1, Dropped())) == single


def test_several_scanners_are_taken_only_where_they_are_named(tmp_path: Path) -> None:
    path = drive(tmp_path / "x.mcap")
    with pytest.raises(
        UsageError, match=r"--topic scan=TOPIC, or several scanners at once with --topic scan=/front,/rear"
    ):
        list(Log(path).events(["scan"]))
    with pytest.raises(UsageError, match="no such topic"):
        list(Log(path, Settings(topics={"scan": "/front,/side"})).events(["scan"]))
    both = [e for e in Log(path, Settings(topics={"scan": "/front,/rear"})).events(["scan"]) if isinstance(e, Scan)]
    assert {scan.topic for scan in both} == {"/front", "/rear"}
