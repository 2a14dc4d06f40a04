"""Windows left out as if the robot had been switched off: nothing tells it what happened in between."""

from pathlib import Path

import numpy as np
import pytest

from pfcli.errors import UsageError
from pfcli.events import Odometry, Ticks, Twist, Wheels, YawRate
from pfcli.replay import cuts
from pfcli.replay.log import Log
from pfcli.replay.settings import Settings
from tests.formats.odd_logs import T0, write

S = 1_000_000_000


def test_odometry_goes_on_where_it_stood(tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", list(range(100)))
    log = Log(tmp_path / "x.mcap", Settings(cuts=((2.0, 4.0), (6.0, 7.0))))
    events = list(log.events(["odometry"]))
    kept = [*range(20), *range(40, 60), *range(70, 100)]
    assert [(e.stamp_ns - T0) // 100_000_000 for e in events] == kept
    x = [e.x_m for e in events if isinstance(e, Odometry)]
    steps = np.diff(x)
    assert np.allclose(np.delete(steps, [19, 39]), 0.1)
    assert np.allclose(steps[[19, 39]], 0.0)


def test_a_turned_odometry_keeps_its_heading() -> None:
    poses = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.5), (5.0, 5.0, 2.0), (5.0, 6.0, 2.1)]
    events = [Odometry(k * S, *pose) for k, pose in enumerate(poses)]
    found = list(cuts.without(events, ((1.5, 1.9),), lambda: 0))
    assert found == events  # a window without a message takes nothing
    found = list(cuts.without([*events[:2], Odometry(S + S // 2, 9, 9, 9), *events[2:]], ((1.2, 1.9),), lambda: 0))
    before, woken, then = found[1:]
    assert isinstance(then, Odometry)
    assert woken[1:4] == pytest.approx(before[1:4])
    ahead = (
        np.cos(2.0) * 0.0 + np.sin(2.0) * 1.0,
        -np.sin(2.0) * 0.0 + np.cos(2.0) * 1.0,
    )  # the step, seen from the robot
    c, s = np.cos(0.5), np.sin(0.5)
    assert then[1:4] == pytest.approx((1.0 + c * ahead[0] - s * ahead[1], s * ahead[0] + c * ahead[1], 0.6))


def test_counters_and_speeds_know_nothing_of_it() -> None:
    nan = np.full(2, np.nan)
    wheels = [Wheels(k * S, ("a", "b"), np.array([k, 2.0 * k]), nan) for k in range(10)]
    ticks = [Ticks(k * S, ("a", "b"), np.array([10 * k, -k]), 100.0, True) for k in range(10)]
    speeds = [Twist(k * S, 1.0, 0.0, 0.1) for k in range(10)]
    rates = [YawRate(k * S, 0.3) for k in range(10)]
    window = ((3.0, 7.0),)
    kept = list(cuts.without(wheels, window, lambda: 0))
    assert [w.position_rad[0] for w in kept] == [0, 1, 2, 2, 3, 4]  # type: ignore[union-attr]
    kept = list(cuts.without(ticks, window, lambda: 0))
    assert [t.ticks.tolist() for t in kept][2:4] == [[20, -2], [20, -2]]  # type: ignore[union-attr]
    kept = list(cuts.without(speeds, window, lambda: 0))
    t, v = [e.stamp_ns / S for e in kept], [e.vx_mps for e in kept]  # type: ignore[union-attr]
    assert np.trapezoid(v, t) == pytest.approx(2.0 + 2.0, abs=1e-6)  # 0 to 2 s and 7 to 9 s
    kept = list(cuts.without(rates, window, lambda: 0))
    assert np.trapezoid([e.yaw_rate_radps for e in kept], [e.stamp_ns / S for e in kept]) == pytest.approx(
        1.2, abs=1e-6
    )  # type: ignore[union-attr]


@pytest.mark.parametrize("text", ["5", "5,3", "a,b", "-1,2", "1,inf"])
def test_flags_that_are_no_window_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--cut"):
        cuts.parse((text,))
    assert cuts.parse(("7,8", "1,2.5")) == ((1.0, 2.5), (7.0, 8.0))


def test_what_lies_behind_the_end_is_not_read(tmp_path: Path) -> None:
    write(tmp_path / "x.mcap", list(range(3000)), chunk_size=20_000)
    log = Log(tmp_path / "x.mcap", Settings(end_s=5.0))
    read = 0

    def counted(batches):  # type: ignore[no-untyped-def]
        nonlocal read
        for batch in batches:
            read += len(batch.log_ns)
            yield batch

    inner = log._file.batches
    log._file.batches = lambda *a: counted(inner(*a))  # type: ignore[method-assign]
    assert len(list(log.events(["odometry"]))) == 51
    assert read < 400
