"""Wheel bases: Jacobians against geometry, the paper's factor, and the noise that wheels hand to a pose."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core.motion import wheels


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3), st.floats(10, 80))
def test_the_step_of_wheels_that_grip_is_found_again_and_nothing_is_left_over(step: list[float], phi: float) -> None:
    for jacobian in (
        wheels.omni(wheels.four_places(math.radians(phi)), [0.2] * 4),
        wheels.omni([0.3, 2.4, 4.5], [0.2, 0.25, 0.3]),
        wheels.mecanum(0.2, 0.17),
    ):
        travel = jacobian @ np.array(step)
        assert np.allclose(wheels.inverse(jacobian) @ travel, step, atol=1e-9)
        assert np.abs(wheels.slip(travel, jacobian, wheels.inverse(jacobian))).max() < 1e-9


def test_a_wheel_rolls_where_its_place_moves() -> None:
    """The travel of an omni wheel is the motion of its place along its own direction."""
    places, arms = [0.2, 1.9, -2.0], [0.21, 0.3, 0.25]
    step = np.array([0.3, -0.2, 0.1])
    for row, a, r in zip(wheels.omni(places, arms), places, arms, strict=True):
        centre = np.array([r * math.cos(a), r * math.sin(a)])
        moved = step[:2] + step[2] * np.array([-centre[1], centre[0]])
        assert row @ step == pytest.approx(moved @ [-math.sin(a), math.cos(a)])


def test_the_papers_factor_one_half_holds_at_45_degrees_only() -> None:
    """Zhang 2011, eq. (3): C = J^T / 2 for the position. C J = diag(2 cos^2 phi, 2 sin^2 phi), which is 1 at 45 degrees."""
    for phi, expected in ((45.0, (1.0, 1.0)), (30.0, (1.5, 0.5))):
        jacobian = wheels.omni(wheels.four_places(math.radians(phi)), [0.2] * 4)
        printed = 0.5 * jacobian[:, :2].T @ jacobian
        assert np.allclose(printed[:, :2], np.diag(expected), atol=1e-12)


def test_one_wheel_that_slips_shows_in_what_is_left_over() -> None:
    jacobian = wheels.omni(wheels.four_places(math.radians(45.0)), [0.2] * 4)
    travel = jacobian @ np.array([0.1, 0.0, 0.0]) + [0.0, 0.04, 0.0, 0.0]
    assert np.allclose(np.abs(wheels.slip(travel, jacobian, wheels.inverse(jacobian))), 0.01)


def test_particles_spread_as_the_wheels_errors_do() -> None:
    """Mean and covariance of many particles against C mean and C diag(sd^2) C^T, at rest, within five standard errors."""
    n = 40_000
    jacobian = wheels.omni(wheels.four_places(math.radians(40.0)), [0.2] * 4)
    back, mean, sd = wheels.inverse(jacobian), np.array([0.01, 0.0, -0.01, 0.02]), np.array([0.01, 0.02, 0.015, 0.01])
    z = np.random.default_rng(0).standard_normal((n, 4))
    poses = wheels.predict(np.zeros((n, 3)), np.zeros(3), back, mean, sd, z)
    # frame half way through a turn of some hundredths: less than a thousandth of the step
    cov = back @ np.diag(sd**2) @ back.T
    assert np.allclose(poses.mean(axis=0), back @ mean, atol=5 * np.sqrt(np.diag(cov).max() / n) + 2e-3)
    assert np.allclose(np.cov(poses.T), cov, atol=5 * math.sqrt(2.0 / n) * np.diag(cov).max() + 2e-5)


def test_a_step_without_noise_ends_where_the_odometry_does() -> None:
    pose, step = np.array([[1.0, 2.0, 0.5]]), np.array([0.3, 0.1, 0.4])
    jacobian = wheels.mecanum(0.2, 0.17)
    moved = wheels.predict(
        pose, wheels.midway(step), wheels.inverse(jacobian), np.zeros(4), np.zeros(4), np.zeros((1, 4))
    )
    c, s = math.cos(0.5), math.sin(0.5)
    assert np.allclose(moved, [[1.0 + c * 0.3 - s * 0.1, 2.0 + s * 0.3 + c * 0.1, 0.9]])
