"""Joints that are reported within a turn."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core.motion.joint_wraps import unwrapped, within_a_turn


@given(st.floats(-9.0, 9.0), st.floats(-3.0, 3.0), st.floats(-7.0, 7.0), st.booleans())
def test_a_step_is_found_within_half_a_turn_of_what_is_expected(
    step: float, off: float, start: float, symmetric: bool
) -> None:
    """off: error of the expectation, less than half a turn."""

    def reported(angle: float) -> float:
        return math.remainder(angle, 2 * math.pi) if symmetric else angle % (2 * math.pi)

    seen = np.array([reported(start + step) - reported(start)])
    found, _ = unwrapped(seen, np.array([step + off]), np.ones(1, bool))
    assert abs(found[0] - step) < 1e-9


def test_a_joint_that_has_left_its_turn_is_believed() -> None:
    step = np.array([4.0, -4.0])
    assert within_a_turn(np.array([6.2, 6.4, -3.1, -3.3])).tolist() == [True, False, True, False]
    found, wraps = unwrapped(step, np.zeros(2), np.array([False, True]))
    assert found.tolist() == [4.0, -4.0 + 2 * np.pi]
    assert wraps == 1
