"""Odometry that jumps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core.geometry import between, compose
from pfcli.dropped import Dropped
from pfcli.errors import LogError
from pfcli.events import Odometry
from pfcli.replay.odometry_resets import OdometryResets

S = 1_000_000_000


def drive(n: int = 200) -> np.ndarray:
    """Poses (n, 3) at 10 Hz of a robot at 0.6 m/s that weaves."""
    poses = np.zeros((n, 3))
    for k in range(1, n):
        poses[k] = compose(poses[k - 1 : k], np.array([[0.06, 0.0, 0.08 * math.sin(k / 10)]]))[0]
    return poses


def told(poses: np.ndarray, dropped: Dropped) -> np.ndarray:
    resets = OdometryResets(dropped)
    events = [resets(Odometry(k * S // 10, *p)) for k, p in enumerate(poses.tolist())]
    return np.array([e[1:4] for e in events if e is not None])


@given(st.integers(30, 180), st.booleans(), st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3))
def test_the_way_goes_on_behind_a_jump(at: int, home: bool, x: float, y: float, yaw: float) -> None:
    """To the origin, or by anything that no step of this robot is: half a metre and more is left out."""
    poses = drive()
    to = np.zeros((1, 3)) if home else compose(poses[at : at + 1], np.array([[x, y, yaw]]))
    jumped = poses.copy()
    jumped[at:] = compose(to, between(poses[at : at + 1], poses[at:]))
    step = between(poses[at - 1 : at], to)[0]
    if not home and math.hypot(step[0], step[1]) < 0.6 and abs(step[2]) < 1.0:
        return
    dropped = Dropped()
    got = told(jumped, dropped)
    assert dropped.counts["reset of the odometry"] == 1
    # the step of the jump is guessed by the step before: 0.06 m and a change of its turn
    assert np.abs(between(poses[-1:], got[-1:])[0][:2]).max() < 0.15
    assert (got[:at] == poses[:at]).all()


def test_a_drive_without_jumps_is_left_as_it_is() -> None:
    dropped = Dropped()
    poses = drive()
    poses[100:, :2] += 0.3  # a slip: wheels report what they did
    assert (told(poses, dropped) == poses).all()
    assert not dropped.counts


def test_a_pose_that_never_changes_while_the_twist_drives_is_refused() -> None:
    resets = OdometryResets(Dropped())
    events = [Odometry(k * S // 10, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0) for k in range(50)]
    with pytest.raises(LogError, match=r"never changes.*0\.3. m.*--motion odometry-twist"):
        list(map(resets, events))


def test_a_robot_that_stands_may_stand() -> None:
    resets = OdometryResets(Dropped())
    for k in range(50):
        assert resets(Odometry(k * S // 10, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)) is not None


def test_odometry_without_a_heading_is_left_out_and_counted() -> None:
    dropped = Dropped()
    assert OdometryResets(dropped)(Odometry(0, 1.0, 0.0, math.nan)) is None
    assert "quaternion is all zero" in dropped.notes[0]
