"""The offset of the scans' clock, from the log itself."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfcli.core.motion.clock_offset import Turns, offset
from pfcli.events import Odometry, Pose2, Scan
from pfcli.formats.log_writer import LogWriter
from pfcli.replay.clock_check import scan_offset
from pfcli.replay.log import Log
from pfcli.replay.settings import Drive, Settings

S = 1_000_000_000
T0 = 1_700_000_000 * S


@pytest.mark.parametrize("late", [0.2, -0.35])
def test_the_offset_is_found(late: float, sample: Callable[[str], Path]) -> None:
    """Odometry of 4 Hz: turns begin and end between its messages."""
    found = scan_offset(Log(sample("small-loop"), Settings(offsets_s={"scan": late})), "odometry", Drive())
    assert found is not None
    assert found.sd_s < 0.01
    assert found.seconds + late == pytest.approx(0.0, abs=3 * found.sd_s)


def test_whole_hours_are_told_by_when_messages_were_recorded(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "x.mcap") as log:
        for k in range(20):
            log.odometry(Odometry(T0 + k * S // 10, 0.0, 0.0, 0.0))
        body = Scan(T0 + 3600 * S, np.ones(9, np.float32), 0.0, 0.1, 0.0, 9.0, Pose2())
        log.scan(body, frame="base_link")
    opened = Log(tmp_path / "x.mcap")
    assert opened.clock_lag_s("scan", "odometry") == 0.0  # recorded when it was stamped, an hour later


def test_a_clock_that_ticks_with_the_other_is_not_pushed_away() -> None:
    """Interpolation averages noise between messages, not at them: an offset of whole periods must not fit worse for that."""
    rng = np.random.default_rng(0)
    off = []
    for _ in range(20):
        t = np.arange(1200) * 0.05
        rate = np.repeat(rng.choice([-0.8, 0.0, 0.8], 60), 20)
        true = np.cumsum(rate) * 0.05
        noisy = true + np.cumsum(0.003 * rng.standard_normal(t.size))
        start = np.arange(1.0, 58.0, 0.2)
        turn = np.interp(start + 0.2, t, true) - np.interp(start, t, true)
        found = offset(Turns(start, start + 0.2, turn, np.full(start.size, 0.1)), t, noisy)
        assert found is not None
        off.append(found.seconds / found.sd_s)
    assert abs(float(np.mean(off))) < 5 / np.sqrt(20)
    assert float(np.std(off)) < 1.6


def test_auto_is_used_and_said(sample: Callable[[str], Path], pfcli: Any, tmp_path: Path) -> None:
    done = pfcli(
        "slam-gdr", sample("small-loop"), "--time-offset", "scan=auto", "--end", "60", "--out", tmp_path / "o", "--json"
    )
    said = [f["seen"] for f in json.loads(done.stdout)["findings"] if f["code"] == "W107"]
    assert len(said) == 1
    assert "late against the motion, +-" in said[0]
