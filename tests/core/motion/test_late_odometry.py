"""Odometry that comes late is found out by its turns, whatever else it errs by."""

import numpy as np
import pytest

from pfcli.core.geometry import between
from pfcli.core.motion.late_odometry import offset_of_odometry


def _drive(turns: bool) -> tuple[np.ndarray, np.ndarray]:
    """Times and poses of a drive of 120 s, straight on or turning this way and that."""
    t = np.arange(0.0, 120.0, 0.05)
    yaw = np.cumsum(0.6 * np.sin(t / 3.0) * (np.sin(t / 7.0) > 0) * 0.05) if turns else np.zeros(t.size)
    return t, np.stack([np.cumsum(0.025 * np.cos(yaw)), np.cumsum(0.025 * np.sin(yaw)), yaw], axis=1)


@pytest.mark.parametrize("late_s", [0.0, 0.5, -0.3])
def test_the_offset_comes_out(late_s: float) -> None:
    """With turns measured 4 % too large, and a drift of 0.01 rad a metre."""
    t, true = _drive(True)
    rng, at = np.random.default_rng(1), np.arange(1.5, 118.0, 0.5)

    def poses(times: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(times, t, column) for column in true.T], axis=1)

    def steps_at(offset_s: float) -> np.ndarray:
        there = poses(at + offset_s - late_s)
        steps = between(there[:-1], there[1:])
        return np.asarray(
            steps * np.array([1, 1, 1.04]) + np.array([0, 0, 0.01]) * np.hypot(steps[:, :1], steps[:, 1:2])
        )

    known = between(poses(at)[:-1], poses(at)[1:])
    known[:, 2] += rng.normal(0, 0.003, len(known))
    assert offset_of_odometry(steps_at, known) == pytest.approx(late_s, abs=0.03)


def test_a_straight_drive_tells_nothing() -> None:
    t, true = _drive(False)
    at = np.arange(1.5, 118.0, 0.5)

    def steps_at(offset_s: float) -> np.ndarray:
        there = np.stack([np.interp(at + offset_s + 0.4, t, column) for column in true.T], axis=1)
        return np.asarray(between(there[:-1], there[1:]))

    assert offset_of_odometry(steps_at, steps_at(0.0)) == 0.0
