"""Motion of any kind, interpolated to the scans."""

import math

import numpy as np
import pytest

from pfcli.dropped import Dropped
from pfcli.errors import UsageError
from pfcli.events import (
    Event,
    Odometry,
    Pose2,
    Range,
    Ranges,
    Scan,
    SourceStamp,
    Steering,
    Ticks,
    Twist,
    Wheels,
    YawRate,
)
from pfcli.replay.align import rounds, sweeps
from pfcli.replay.dead_reckoning import DeadReckoning
from pfcli.replay.settings import Drive

S = 1_000_000_000
DRIVE = Drive(radius_m=(0.1,), track_m=0.5)


def _scan(t: float) -> Scan:
    return Scan(int(t * S), np.ones(3, np.float32), 0.0, 0.1, 0.0, 9.0, Pose2())


def test_odometry_is_interpolated_to_the_scans_stamp() -> None:
    events: list[Event] = [Odometry(0, 0.0, 0.0, 3.0), _scan(0.25), Odometry(S, 1.0, 2.0, -3.0)]
    (sweep,) = sweeps(events, "odometry", Drive(), Dropped())
    turn = 2 * math.pi - 6.0
    assert sweep.odometry == pytest.approx((0.25, 0.5, 3.0 + turn / 4))


def test_a_scan_with_its_own_odometry_is_not_held_back() -> None:
    events: list[Event] = [SourceStamp(0, "0.5"), Odometry(0, 1.0, 0.0, 0.0), _scan(0)]
    (sweep,) = sweeps(iter(events), "odometry", Drive(), Dropped())
    assert sweep.odometry == (1.0, 0.0, 0.0)
    assert sweep.source_stamp == "0.5"


def test_scans_outside_the_odometry_are_counted() -> None:
    dropped = Dropped()
    events: list[Event] = [_scan(0), Odometry(S, 0, 0, 0), Odometry(2 * S, 0, 0, 0), _scan(2.5), _scan(9)]
    assert [s.stamp_ns for s in sweeps(events, "odometry", Drive(), dropped)] == [int(2.5 * S)]
    assert dict(dropped.counts) == {"scan before odometry": 1, "scan without odometry": 1}


def test_a_pause_of_the_odometry_is_said() -> None:
    dropped = Dropped()
    events: list[Event] = [Odometry(0, 0, 0, 0), _scan(30), Odometry(60 * S, 1, 0, 0)]
    assert len(list(sweeps(events, "odometry", Drive(), dropped))) == 1
    assert "pauses for 60.0 s" in dropped.notes[0]


def test_without_any_motion_every_scan_is_counted() -> None:
    dropped = Dropped()
    assert list(sweeps([_scan(0), _scan(1)], "odometry", Drive(), dropped)) == []
    assert dict(dropped.counts) == {"scan without odometry": 2}


def test_a_car_drives_the_circle_that_its_wheels_ask_for() -> None:
    """Wheelbase 2 m, steering 30 degrees: a radius of 2 / tan 30; half the circle ends straight across."""
    dropped, radius = Dropped(), 2.0 / math.tan(math.radians(30))
    reckon = DeadReckoning("twist", Drive(axles_m=2.0), dropped)
    seconds = math.pi * radius / 1.5
    last = [reckon(Steering(int(seconds * k / 2000 * S), 1.5, math.radians(30))) for k in range(2001)][-1]
    assert last is not None
    assert (last.x_m, last.y_m) == pytest.approx((0.0, 2 * radius), abs=1e-3)
    assert abs(last.yaw_rad) == pytest.approx(math.pi, abs=1e-4)
    assert reckon(Steering(int(99 * S), 1.0, 1.6)) is None
    assert reckon(Steering(int(99 * S), 1.0, math.nan)) is None
    assert dict(dropped.counts) == {"steering angle": 2}
    with pytest.raises(UsageError, match="--axle-distance-m"):
        DeadReckoning("twist", Drive())(Steering(0, 1.0, 0.1))


@pytest.mark.parametrize("cumulative", [True, False])
def test_ticks_drive_an_arc(cumulative: bool) -> None:
    """A quarter turn to the left on a circle of radius 1 m."""
    reckon = DeadReckoning("encoders", DRIVE)
    steps, turn = 1000, 10_000_000.0
    left, right = (0.75 * math.pi / 2 / (2 * math.pi * 0.1) * turn, 1.25 * math.pi / 2 / (2 * math.pi * 0.1) * turn)
    out = None
    for k in range(steps + 1):
        share = (k if cumulative else (1 if k else 0)) / steps
        ticks = np.round([left * share, right * share]).astype(np.int64)
        out = reckon(Ticks(k, ("left", "right"), ticks, turn, cumulative))
    assert out is not None
    assert out[1:4] == pytest.approx((1.0, 1.0, math.pi / 2), abs=1e-3)


def test_a_counter_that_wraps_goes_on() -> None:
    reckon = DeadReckoning("encoders", DRIVE)
    for value in (2**31 - 500, -(2**31) + 500):
        out = reckon(Ticks(0, ("left", "right"), np.array([value, value]), 1000.0, True))
    assert out is not None
    assert out.x_m == pytest.approx(2 * math.pi * 0.1)


def test_joint_states_work_by_position_or_by_velocity() -> None:
    by_position, by_velocity = DeadReckoning("encoders", DRIVE), DeadReckoning("encoders", DRIVE)
    nan = np.full(2, np.nan)
    for k in range(11):
        a = by_position(Wheels(k * S // 10, ("wheel_left", "wheel_right"), np.array([k * 1.0, k * 1.0]), nan))
        b = by_velocity(Wheels(k * S // 10, ("wheel_left", "wheel_right"), nan, np.array([10.0, 10.0])))
    assert a is not None
    assert b is not None
    assert a.x_m == pytest.approx(1.0)
    assert b.x_m == pytest.approx(1.0)


def test_twist_and_gyroscope_integrate_to_the_same_circle() -> None:
    twist, imu = DeadReckoning("twist", Drive()), DeadReckoning("imu", Drive())
    for k in range(0, 1001):
        a = twist(Twist(k * S // 100, 0.5, 0.0, 0.2))
        imu(Twist(k * S // 100, 0.5, 0.0, float("nan")))
        b = imu(YawRate(k * S // 100, 0.2))
    assert a is not None
    assert b is not None
    assert a[1:4] == pytest.approx((2.5 * math.sin(2.0), 2.5 * (1 - math.cos(2.0)), 2.0), abs=1e-4)
    assert b[1:4] == pytest.approx(a[1:4], abs=1e-9)


def test_wheels_that_cannot_be_told_apart_are_asked_for() -> None:
    with pytest.raises(UsageError, match="--wheel-joints LEFT,RIGHT"):
        DeadReckoning("encoders", DRIVE)(Ticks(0, ("a", "b"), np.zeros(2, np.int64), 100.0, True))
    with pytest.raises(UsageError, match="--wheel-radius-m"):
        DeadReckoning("encoders", Drive())(Ticks(0, ("left", "right"), np.zeros(2, np.int64), 100.0, True))
    with pytest.raises(UsageError, match="no joint 'x'"):
        DeadReckoning("encoders", DRIVE._replace(joints=("x", "y")))(
            Ticks(0, ("a", "b"), np.zeros(2, np.int64), 9.0, True)
        )


def _range(stamp: int, topic: str, value: float) -> Range:
    return Range(stamp, topic, value, 0.02, 4.0, Pose2(0.1, 0.0, 0.0))


def test_a_round_of_range_finders_ends_when_all_have_reported_or_one_reports_again() -> None:
    events = [_range(1, "/a", 1.0), _range(2, "/b", 2.0), _range(3, "/a", 3.0), _range(4, "/b", 4.0)]
    events += [_range(5, "/b", 5.0), _range(6, "/b", 6.0), _range(7, "/a", 7.0)]
    found = [(r.stamp_ns, r.ranges_m.tolist()) for r in rounds(events) if isinstance(r, Ranges)]
    assert found == [(2, [1.0, 2.0]), (4, [3.0, 4.0]), (5, [5.0]), (7, [7.0, 6.0])]


def test_a_jump_of_the_encoders_is_counted_and_left_out() -> None:
    dropped = Dropped()
    reckon = DeadReckoning("encoders", Drive(radius_m=(0.1,), track_m=0.3), dropped)
    names = ("left", "right")
    rows = [(0, 0), (100, 100), (900_000, 900_100), (900_100, 900_200)]
    poses = [reckon(Ticks(k * 50_000_000, names, np.array(row), 1000.0, True)) for k, row in enumerate(rows)]
    assert dropped.counts["jump of the encoders"] == 1
    last = poses[-1]
    assert last is not None
    assert last.x_m == pytest.approx(2 * 100 / 1000 * 2 * np.pi * 0.1, rel=1e-9)
