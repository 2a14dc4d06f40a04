"""Clocks that are off, by turns."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core.motion.clock_offset import Turns, offset


def drive(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and heading of 60 s at 50 Hz: turns that begin and end."""
    rng = np.random.default_rng(seed)
    rates = np.repeat(rng.choice([-0.8, 0.0, 0.0, 0.8], 60), 50)
    return np.arange(3000) * 0.02, np.cumsum(rates) * 0.02


@given(st.integers(0, 1000), st.floats(-0.9, 0.9), st.floats(0.95, 1.05))
def test_the_offset_is_found_within_five_of_its_standard_deviations(seed: int, by: float, scale: float) -> None:
    t, yaw = drive(seed)
    rng = np.random.default_rng(seed + 1)
    start = np.arange(2.0, 57.0, 0.2)
    turn = scale * (np.interp(start + 0.2, t, yaw) - np.interp(start, t, yaw)) + 0.002 * rng.standard_normal(start.size)
    found = offset(Turns(start - by, start + 0.2 - by, turn, np.zeros(start.size)), t, yaw)
    assert found is not None
    assert found.seconds == pytest.approx(by, abs=5 * found.sd_s)
    assert found.sd_s < 1e-3
    assert found.scale == pytest.approx(scale, abs=0.01)


def test_a_drive_without_turns_tells_nothing() -> None:
    t = np.arange(100) * 0.1
    assert offset(Turns(t[:-1], t[1:], np.zeros(99), np.zeros(99)), t, np.zeros(100)) is None
