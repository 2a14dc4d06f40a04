"""The belief over six states, and what an update of it is given."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Belief(NamedTuple):
    """Particles and class probabilities, and what the update says of itself. b[0]: part of class 3 without a pose, and
    credit: log likelihood over the outside that it had for this scan."""

    pose: NDArray[np.float64]
    label: NDArray[np.uint8]
    weight: NDArray[np.float64]
    b: NDArray[np.float64]
    transition: NDArray[np.float64] = np.eye(7)
    log_evidence: float = 0.0
    n_eff: float = 0.0
    credit: float = 0.0


def in_the_map(label: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Which particles (n,) are of the classes that a scan can be held against: 2, 3 and 6 (eq. (14))."""
    return np.asarray((label == 2) | (label == 3) | (label == 6))


def share_in_map(b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...,) probability of being in the map, of class probabilities (..., 7)."""
    return np.asarray(b[..., 0] + b[..., 2] + b[..., 3] + b[..., 6])


class Past(NamedTuple):
    """An update before: its reckoned pose (3,), its beams as in `Reading`, and the log likelihood that those who are somewhere in
    the map have been credited with for it."""

    reckoned: NDArray[np.float64]
    ends: NDArray[np.float32]
    level: NDArray[np.int32]
    base: NDArray[np.float32]
    credit: float


class Reading(NamedTuple):
    """What an update brings: step (3,) since the last one in the base frame, whether it is the first, end points of the
    scan float32 (2, b), for each beam the level of the field (b,) and what the last metres explain (2, b), the stamp; the
    reckoned pose (3,), updates of the last metres, and for each beam whether it ends at a thing that the map is known to lack;
    way since the start (m)."""

    moved: NDArray[np.float64]
    first: bool
    ends: NDArray[np.float32]
    level: NDArray[np.int32]
    base: NDArray[np.float32]
    stamp_ns: int
    reckoned: NDArray[np.float64] = np.zeros(3)
    past: Sequence[Past] = ()
    things: NDArray[np.bool_] | None = None
    way_m: float = np.inf
