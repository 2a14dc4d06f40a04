"""The pose between two solutions of the whole past: particles taken back by what their ancestors were drawn off (decision 023).

A few particles that are resampled at every second observation soon share an ancestor, whose world was drawn off the mean: their
own mean and spread are those of a few draws.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate
from pfcli.core.geometry import between, compose


class Anchor(NamedTuple):
    """Where the particles were drawn anew last: pose (3,) and covariance (3, 3) by the least squares; shift (n, 3): the motion
    that takes that pose to where each particle, or its ancestor, was drawn."""

    pose: NDArray[np.float64]
    cov: NDArray[np.float64]
    shift: NDArray[np.float64]


def unmoved(n: int) -> Anchor:
    """All n particles are what they were drawn from."""
    return Anchor(np.zeros(3), np.zeros((3, 3)), np.zeros((n, 3)))


def at(mean: NDArray[np.float64], cov: NDArray[np.float64], drawn: NDArray[np.float64]) -> Anchor:
    """Particles drawn (n, 3) from a Gaussian of this mean (3,) and covariance (3, 3)."""
    return Anchor(mean, cov, compose(drawn, between(mean[None], np.zeros((1, 3)))))


def estimated(anchor: Anchor, pose: NDArray[np.float64], weights: NDArray[np.float64]) -> estimate.PoseEstimate:
    """Mean of the poses (n, 3), each taken back by its shift; the anchor's covariance, carried along, and their spread."""
    found = estimate.whole(between(anchor.shift, pose), weights)
    dx, dy, _ = found.pose - anchor.pose
    moved = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    return found._replace(cov=found.cov + moved @ anchor.cov @ moved.T)
