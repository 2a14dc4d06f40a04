"""Joint angles that are reported within one turn, -pi .. pi or 0 .. 2 pi, as steps of wheels."""

import numpy as np
from numpy.typing import NDArray

TURN = 2 * np.pi
_EDGE = 0.02
"""Angles may overshoot the end of their turn by so much (rad)."""


def within_a_turn(angle_rad: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(k,) whether each angle can be one that is reported within -pi .. pi or 0 .. 2 pi."""
    return np.asarray((np.abs(angle_rad) <= np.pi + _EDGE) | ((angle_rad >= -_EDGE) & (angle_rad <= TURN + _EDGE)))


def unwrapped(
    step_rad: NDArray[np.float64], expected_rad: NDArray[np.float64], may_wrap: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], int]:
    """Steps (k,) of joints, and how many of them have wrapped.

    A joint that may wrap took the step nearest to the expected one among those a turn apart, where the reported step, or
    its difference from the expected one, is more than half a turn; within half a turn of the truth that is right.
    """
    turns = np.round((expected_rad - step_rad) / TURN)
    doubtful = may_wrap & (turns != 0) & ((np.abs(step_rad) > np.pi) | (np.abs(step_rad - expected_rad) > np.pi))
    return np.asarray(step_rad + np.where(doubtful, turns, 0.0) * TURN), int(doubtful.sum())
