"""Compass: heading of a magnetic field, its likelihood, and the bias that is learnt."""

import math

import numpy as np
import pytest

from pfcli.core.sensor import compass


@pytest.mark.parametrize("yaw_deg", [-170.0, -90.0, 0.0, 30.0, 135.0])
def test_the_heading_is_that_of_a_robot_that_turns_under_the_field(yaw_deg: float) -> None:
    """The field points north; seen from a robot whose heading is `yaw` (counter-clockwise from east) it is turned back."""
    angle = math.pi / 2 - math.radians(yaw_deg)
    assert math.degrees(compass.heading(2e-5 * math.cos(angle), 2e-5 * math.sin(angle))) == pytest.approx(yaw_deg)


def test_the_printed_formula_is_off_by_90_degrees() -> None:
    """Zhang 2011 prints arctan(Hx / Hy); with Hx = H cos psi, Hy = -H sin psi it is psi - 90 degrees modulo 180."""
    psi = math.radians(30.0)
    printed = math.atan(math.cos(psi) / -math.sin(psi))
    assert math.degrees(printed - psi) % 180.0 == pytest.approx(90.0)


def test_the_likelihood_is_a_density_over_headings() -> None:
    yaw = np.linspace(-math.pi, math.pi, 20_001)[:-1]
    density = np.exp(compass.fit(yaw, 2.9, compass.Compass(math.radians(10.0), 0.05)))
    assert density.mean() * 2 * math.pi == pytest.approx(1.0, abs=1e-6)
    assert yaw[np.argmax(density)] == pytest.approx(2.9, abs=1e-3)


def test_a_constant_bias_is_learnt_and_a_bent_reading_is_not() -> None:
    rng = np.random.default_rng(0)
    bias = compass.Bias()
    for _ in range(600):
        error = math.radians(12.0) + math.radians(5.0) * rng.standard_normal()
        bias = compass.learn(bias, error - bias.mean_rad, math.radians(5.0), 1 / 15, 1.0)
    assert math.degrees(bias.mean_rad) == pytest.approx(12.0, abs=2.0)
    assert compass.learn(bias, math.radians(90.0), math.radians(5.0), 1 / 15, 1.0).mean_rad == bias.mean_rad
    assert compass.is_bent(bias, math.radians(90.0), math.radians(5.0))
    assert not compass.is_bent(bias, math.radians(5.0), math.radians(5.0))
