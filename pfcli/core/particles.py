"""Sets of weighted poses: the bin of a pose, and choosing initial ones."""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
from pfcli.core.jit import inline_kernel


@inline_kernel
def pose_bin(poses, i, side_m, side_rad):
    """Hash (uint64) of the bin (side_m, side_m, side_rad) that pose i of (n, 3) falls into."""
    bx, by = np.int64(np.floor(poses[i, 0] / side_m)), np.int64(np.floor(poses[i, 1] / side_m))
    bt = np.int64(np.floor((wrap(poses[i, 2]) + np.pi) / side_rad))
    h = np.uint64(bx * 73856093) ^ np.uint64(by * 19349663) ^ np.uint64(bt * 83492791)
    return h ^ (h >> np.uint64(17))


def uniform(
    xy_m: NDArray[np.float64],
    half_cell_m: float,
    n: int,
    rng: np.random.Generator,
    yaw: tuple[float, float] | None = None,
) -> NDArray[np.float64]:
    """(n, 3) poses uniform over cells with centres xy_m (k, 2).

    yaw: mean and standard deviation of the heading (rad); None: any heading.
    """
    out = np.empty((n, 3))
    out[:, :2] = xy_m[rng.integers(xy_m.shape[0], size=n)] + rng.uniform(-half_cell_m, half_cell_m, (n, 2))
    out[:, 2] = rng.uniform(-np.pi, np.pi, n) if yaw is None else yaw[0] + yaw[1] * rng.standard_normal(n)
    return out


def gaussian(
    mean: NDArray[np.float64], sd: NDArray[np.float64], n: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """(n, 3) poses around `mean` (3,) with standard deviations `sd` (3,)."""
    return np.asarray(mean + sd * rng.standard_normal((n, 3)))
