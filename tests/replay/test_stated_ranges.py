"""A range within range_max that means 'no return' is told from the log, whatever the container."""

from pathlib import Path

import numpy as np
import pytest

from pfcli.events import Odometry, Pose2, Scan
from pfcli.formats.log_writer import LogWriter
from pfcli.replay.log import Log
from tests.formats.odd_logs import T0


def _write(path: Path, none_m: float, stated_m: float, outlier_m: float = 0.0) -> Path:
    angles = np.radians(np.arange(-90, 91))
    with LogWriter(path) as out:
        out.tf_static(T0, [("base_link", "laser", Pose2())])
        for k in range(200):
            t = T0 + k * 100_000_000
            out.odometry(Odometry(t, 0.05 * k, 0.0, 0.0))
            with np.errstate(divide="ignore"):
                ranges = 3.0 / np.abs(np.sin(angles)) + 0.001 * k
            ranges = np.where(ranges > 20, none_m, ranges).round(3)
            if k == 50 and outlier_m:
                ranges[90] = outlier_m
            out.scan(Scan(t, ranges.astype(np.float32), -np.pi / 2, np.pi / 180, 0.1, stated_m, Pose2()))
    return path


@pytest.mark.parametrize("outlier_m", [0.0, 51.25])
def test_it_is_used_and_said(outlier_m: float, tmp_path: Path) -> None:
    log = Log(_write(tmp_path / "x.mcap", 51.15, 100.0, outlier_m))
    (top,) = {e.range_max_m for e in log.events(["odometry", "scan"]) if isinstance(e, Scan)}
    assert 51.1 < top < 51.15
    (finding,) = [f for f in log.dropped.found if f.code == "W306"]
    assert "51.150-51.150 m" in finding.seen
    assert not finding.shakes


@pytest.mark.parametrize(("none_m", "stated_m"), [(np.inf, 100.0), (30.0, 30.0), (81.9, 80.0)])
def test_drivers_that_mark_it_are_left_alone(none_m: float, stated_m: float, tmp_path: Path) -> None:
    log = Log(_write(tmp_path / "x.mcap", none_m, stated_m))
    (top,) = {e.range_max_m for e in log.events(["odometry", "scan"]) if isinstance(e, Scan)}
    assert top == pytest.approx(stated_m)
    assert not log.dropped.found
