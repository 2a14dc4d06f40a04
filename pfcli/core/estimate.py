"""What a weighted set of poses says: mean, covariance, and the hypothesis that holds most of the mass."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
from pfcli.core.jit import kernel
from pfcli.core.particles import pose_bin


class PoseEstimate(NamedTuple):
    """pose (3,), m and rad; cov (3, 3); mass: share of the weight that it rests on."""

    pose: NDArray[np.float64]
    cov: NDArray[np.float64]
    mass: float


@kernel
def _around(poses, weights, centre, reach_m, reach_rad, mean, cov):  # type: ignore[no-untyped-def]
    """Weighted mean and covariance of the poses within reach of `centre`, headings unrolled there; returns their weight."""
    total, sx, sy, st = 0.0, 0.0, 0.0, 0.0
    for i in range(poses.shape[0]):
        dx, dy, dt = poses[i, 0] - centre[0], poses[i, 1] - centre[1], wrap(poses[i, 2] - centre[2])
        if dx * dx + dy * dy <= reach_m * reach_m and abs(dt) <= reach_rad:
            total += weights[i]
            sx += weights[i] * dx
            sy += weights[i] * dy
            st += weights[i] * dt
    if total <= 0.0:
        return 0.0
    mx, my, mt = sx / total, sy / total, st / total
    cov[:] = 0.0
    for i in range(poses.shape[0]):
        dx, dy, dt = poses[i, 0] - centre[0], poses[i, 1] - centre[1], wrap(poses[i, 2] - centre[2])
        if dx * dx + dy * dy <= reach_m * reach_m and abs(dt) <= reach_rad:
            w = weights[i] / total
            e0, e1, e2 = dx - mx, dy - my, dt - mt
            cov[0, 0] += w * e0 * e0
            cov[0, 1] += w * e0 * e1
            cov[0, 2] += w * e0 * e2
            cov[1, 1] += w * e1 * e1
            cov[1, 2] += w * e1 * e2
            cov[2, 2] += w * e2 * e2
    cov[1, 0], cov[2, 0], cov[2, 1] = cov[0, 1], cov[0, 2], cov[1, 2]
    mean[0], mean[1], mean[2] = centre[0] + mx, centre[1] + my, wrap(centre[2] + mt)
    return total


@kernel
def _densest(poses, weights, side_m, side_rad, slots):  # type: ignore[no-untyped-def]
    """Index of the heaviest pose in the heaviest bin (hashed, so that the extent of the map does not matter)."""
    mask = slots.size - 1
    best, heaviest = np.uint64(0), -1.0
    for i in range(poses.shape[0]):
        h = pose_bin(poses, i, side_m, side_rad) & np.uint64(mask)
        slots[h] += weights[i]
        if slots[h] > heaviest:
            heaviest, best = slots[h], h
    chosen, weight = 0, -1.0
    for i in range(poses.shape[0]):
        if pose_bin(poses, i, side_m, side_rad) & np.uint64(mask) == best and weights[i] > weight:
            chosen, weight = i, weights[i]
    return chosen


def whole(poses: NDArray[np.float64], weights: NDArray[np.float64]) -> PoseEstimate:
    """Mean and covariance of all poses (n, 3) with weights (n,); headings by their circular mean."""
    s, c = weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2])
    centre = np.array([*(weights @ poses[:, :2] / weights.sum()), np.arctan2(s, c)])
    mean, cov = np.empty(3), np.empty((3, 3))
    mass = _around(poses, weights, centre, np.inf, np.inf, mean, cov)
    return PoseEstimate(mean, cov, float(mass))


def densest(poses: NDArray[np.float64], weights: NDArray[np.float64], reach_m: float, reach_rad: float) -> PoseEstimate:
    """Mean of the hypothesis that holds most of the mass: the poses within reach of the heaviest bin.

    poses: (n, 3); weights: (n,). A mean over several hypotheses would lie between them, where the robot is not.
    """
    slots = np.zeros(1 << max(8, int(poses.shape[0] * 2).bit_length()))
    start = poses[_densest(poses, weights, reach_m, reach_rad, slots)]
    mean, cov = start.copy(), np.zeros((3, 3))
    mass = _around(poses, weights, start, reach_m, reach_rad, mean, cov)
    centre = mean.copy()
    mass = _around(poses, weights, centre, reach_m, reach_rad, mean, cov)
    return PoseEstimate(mean, cov, float(mass))
