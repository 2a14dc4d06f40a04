"""What a weighted set of poses says: mean, covariance, and the hypothesis that holds most of the mass."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
from pfcli.core.jit import kernel, put
from pfcli.core.particles import pose_bin

_CANDIDATES = 12
_ALL = 1.0 - 1e-9


class PoseEstimate(NamedTuple):
    """pose (3,), m and rad; cov (3, 3); mass: share of the weight that it rests on."""

    pose: NDArray[np.float64]
    cov: NDArray[np.float64]
    mass: float

    @property
    def sd_m(self) -> float:
        """Root of the variance of the place, both axes together (m)."""
        return float(np.sqrt(self.cov[0, 0] + self.cov[1, 1]))

    @property
    def sd_yaw_rad(self) -> float:
        """Standard deviation of the heading (rad)."""
        return float(np.sqrt(self.cov[2, 2]))


@kernel
def _around(poses, weights, centre, reach_m, reach_rad, mean, cov):
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
def _fill(poses, weights, side_m, side_rad, slots, heaviest):
    """Weight of every hashed bin, so that the extent of the map does not matter, and its heaviest pose."""
    mask = np.uint64(slots.size - 1)
    for i in range(poses.shape[0]):
        h = pose_bin(poses, i, side_m, side_rad) & mask
        slots[h] += weights[i]
        if heaviest[h] < 0 or weights[i] > weights[heaviest[h]]:
            heaviest[h] = i


@kernel
def _twice_around(poses, weights, reach_m, reach_rad, mean, cov):
    """`_around` the mean (3,) that is given, and once more around the one that was found."""
    mass = 0.0
    for _ in range(2):
        mass = _around(poses, weights, mean.copy(), reach_m, reach_rad, mean, cov)
    return mass


@kernel
def _best_around(poses, weights, slots, heaviest, reach_m, reach_rad, pose, cov):
    """The heaviest neighbourhood of the heaviest bins, the first of equals; consumes `slots`, returns its weight."""
    best = 0.0
    mean, spread = np.empty(3), np.empty((3, 3))
    for _ in range(_CANDIDATES):
        slot = np.argmax(slots)
        # a hypothesis on the border of bins is split among up to eight of them: compare whole neighbourhoods
        if slots[slot] <= 0.0 or best >= _ALL:
            break
        slots[slot] = 0.0
        put(mean, poses[heaviest[slot]])
        mass = _twice_around(poses, weights, reach_m, reach_rad, mean, spread)
        if mass > best:
            best = mass
            put(pose, mean)
            put(cov, spread)
    return best


def whole(poses: NDArray[np.float64], weights: NDArray[np.float64]) -> PoseEstimate:
    """Mean and covariance of all poses (n, 3) with weights (n,); headings by their circular mean."""
    s, c = weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2])
    centre = np.array([*(weights @ poses[:, :2] / weights.sum()), np.arctan2(s, c)])
    mean, cov = np.empty(3), np.empty((3, 3))
    mass = _around(poses, weights, centre, np.inf, np.inf, mean, cov)
    return PoseEstimate(mean, cov, float(mass))


def around(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    centre: NDArray[np.float64],
    reach_m: float,
    reach_rad: float,
) -> PoseEstimate:
    """The hypothesis within reach of `centre` (3,), which is its own mean where there is none. poses: (n, 3); weights: (n,)."""
    mean, cov = centre.copy(), np.zeros((3, 3))
    mass = _twice_around(poses, weights, reach_m, reach_rad, mean, cov)
    return PoseEstimate(mean, cov, float(mass))


def densest(poses: NDArray[np.float64], weights: NDArray[np.float64], reach_m: float, reach_rad: float) -> PoseEstimate:
    """Mean of the hypothesis that holds most of the mass: the poses within reach of the heaviest bin.

    poses: (n, 3); weights: (n,), sum 1. A mean over several hypotheses would lie between them, where the robot is not.
    """
    size = 1 << max(8, int(poses.shape[0] * 2).bit_length())
    slots, heaviest = np.zeros(size), np.full(size, -1)
    _fill(poses, weights, reach_m, reach_rad, slots, heaviest)
    pose, cov = poses[int(np.argmax(weights))].copy(), np.zeros((3, 3))
    mass = _best_around(poses, weights, slots, heaviest, reach_m, reach_rad, pose, cov)
    return PoseEstimate(pose, cov, float(mass))


@kernel
def members(poses, centre, reach_m, reach_rad):
    """(n,) which poses (n, 3) belong to the hypothesis at `centre` (3,)."""
    out = np.empty(poses.shape[0], np.bool_)
    for i in range(poses.shape[0]):
        dx, dy = poses[i, 0] - centre[0], poses[i, 1] - centre[1]
        out[i] = dx * dx + dy * dy <= reach_m * reach_m and abs(wrap(poses[i, 2] - centre[2])) <= reach_rad
    return out


@kernel
def distinct(poses, order, most, apart_m, apart_rad):
    """The first `most` of the poses order (k,) of (n, 3), each farther than both from all before it."""
    kept = np.empty(min(most, order.size), np.int64)
    count = 0
    for i in order:
        if count == kept.size:
            break
        apart = True
        for j in range(count):
            k = kept[j]
            near = np.hypot(poses[i, 0] - poses[k, 0], poses[i, 1] - poses[k, 1]) <= apart_m
            if near and abs(wrap(poses[i, 2] - poses[k, 2])) <= apart_rad:
                apart = False
                break
        if apart:
            kept[count] = i
            count += 1
    return kept[:count]


def modes(
    poses: NDArray[np.float64], weights: NDArray[np.float64], reach_m: float, reach_rad: float, least: float = 0.05
) -> int:
    """How many hypotheses, farther apart than reach, have a bin with at least this share of the weight.

    poses: (n, 3); weights: (n,), sum 1.
    """
    size = 1 << max(8, int(poses.shape[0] * 2).bit_length())
    slots, heaviest = np.zeros(size), np.full(size, -1)
    _fill(poses, weights, reach_m, reach_rad, slots, heaviest)
    order = np.argsort(-slots, kind="stable")[: int(np.count_nonzero(slots >= least))]
    return int(distinct(poses, heaviest[order], order.size, 2 * reach_m, 2 * reach_rad).size)
