"""What odometry errs by always is told from what it errs by chance."""

import numpy as np
import pytest

from pfcli.core.motion.odometry import standard_deviations
from pfcli.core.motion.odometry_calibration import calibrate

WAY, DRIFT, PER_M, TURN = -0.03, 0.015, 0.02, 0.05


def _drive(n: int, turning: bool) -> tuple[np.ndarray, np.ndarray]:
    """Odometry of n steps of 0.25 m, every fifth of which turns, and what was driven."""
    rng = np.random.default_rng(0)
    steps = np.stack([np.full(n, 0.25), np.zeros(n), np.zeros(n)], axis=1)
    if turning:
        steps[::5, 2] = rng.choice([-0.3, 0.3], len(steps[::5]))
    known = steps + np.stack([WAY * steps[:, 0], DRIFT * steps[:, 0], PER_M * steps[:, 0] + TURN * steps[:, 2]], axis=1)
    known += rng.normal(0, [0.004, 0.002, 0.003], (n, 3))
    known[rng.choice(n, n // 30, replace=False), 0] -= 0.2  # slips
    return steps, known


def test_systematic_errors_are_found_in_spite_of_slips() -> None:
    steps, known = _drive(3000, True)
    found = calibrate(steps, known)
    assert found is not None
    # standard errors: 0.004 / 0.25 / sqrt(3000) and so on; Cauchy weights cost some of it
    assert found.way == pytest.approx(WAY, abs=5 * 0.0003)
    assert found.drift == pytest.approx(DRIFT, abs=5 * 0.00015)
    assert found.turn_per_m == pytest.approx(PER_M, abs=5 * 0.00025)
    assert found.turn == pytest.approx(TURN, abs=5 * 0.0005)
    assert np.abs((found.corrected(steps) - known).mean(axis=0)[1:]).max() < 0.0005
    assert found.sd_xy_m == pytest.approx(0.0032, rel=0.15)  # of both coordinates together
    # the noise it gives is twice what it saw, for a step of that length
    assert standard_deviations(np.array([found.way_m, 0.0, 0.0]), found.noise())[0] == pytest.approx(2 * found.sd_xy_m)


def test_noise_of_a_straight_drive_is_no_scale_of_turns() -> None:
    steps, known = _drive(1000, False)
    steps[:, 2] += np.random.default_rng(1).normal(0, 0.01, 1000)
    found = calibrate(steps, known)
    assert found is not None
    assert found.turn == 0.0


def test_a_robot_that_drives_sideways_is_calibrated_alike() -> None:
    """Its scale and drift are told by the way that it makes; what turns it per metre ahead it does not make."""
    rng, n = np.random.default_rng(2), 2000
    steps = np.stack([rng.normal(0, 0.003, n), np.full(n, 0.25), np.zeros(n)], axis=1)
    known = steps + np.stack([-DRIFT * steps[:, 1], WAY * steps[:, 1], np.zeros(n)], axis=1)
    known += rng.normal(0, [0.004, 0.004, 0.003], (n, 3))
    found = calibrate(steps, known)
    assert found is not None
    assert (found.way, found.drift) == (pytest.approx(WAY, abs=5 * 0.0005), pytest.approx(DRIFT, abs=5 * 0.0005))
    assert (found.turn_per_m, found.turn) == (0.0, 0.0)
    assert found.way_m == pytest.approx(0.25, rel=0.01)
    assert np.abs((found.corrected(steps) - known).mean(axis=0)).max() < 0.0005
    assert found.sd_yaw_rad == pytest.approx(0.003, rel=0.1)


def test_a_robot_at_rest_teaches_nothing() -> None:
    assert calibrate(np.zeros((100, 3)), np.zeros((100, 3))) is None
    assert calibrate(np.zeros((0, 3)), np.zeros((0, 3))) is None
    noise = np.random.default_rng(3).normal(0, 0.003, (2, 500, 3))
    assert calibrate(*noise) is None
