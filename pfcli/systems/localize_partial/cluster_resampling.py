"""Each cluster is resampled on its own (Zhang 2010, algorithm 1, line 9), to the size that keeps its spread (Fox 2003)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.resample import systematic
from pfcli.systems.localize_partial import cluster_kernels
from pfcli.systems.localize_partial.relocalise import Placed
from pfcli.systems.shared.resampling import by_name

Choose = Callable[[NDArray[np.float64], int, float], NDArray[np.int64]]
"""Parents (count,) by weights (n,), which need not sum to 1, and the offset that the cluster's size was found with."""


class Limits(NamedTuple):
    """least, most: particles of a cluster; lost: of classes 2 and 3 when they hold next to no weight; share: resample below
    this N_eff / n; error: for the KLD bound (0: always `most`); side_m, side_rad: of its bins; negligible: clusters with less
    weight are dropped."""

    least: int
    lost: int
    most: int
    share: float
    error: float
    side_m: float
    side_rad: float
    negligible: float


def chooser(name: str, rng: np.random.Generator) -> Choose:
    """The resampler of this name. Systematic takes the offset of the trial that told the size: it hits the very bins."""
    if name == "systematic":
        return lambda weights, count, u: np.asarray(systematic.choose(weights, u, count))
    return lambda weights, count, u: by_name(name, weights / weights.sum(), count, rng)


def regroup(placed: Placed, u: NDArray[np.float64], limits: Limits, choose: Choose) -> Placed:
    """Resample the clusters whose N_eff is low or that have grown too large. u: (7,), one offset per class."""
    pose, label, weight = placed
    quota, mass = cluster_kernels.quotas(pose, label, weight, u, *limits)
    parents, weights = [np.empty(0, np.int64)], [np.empty(0)]
    for k in np.flatnonzero(quota).tolist():
        cluster, wanted = np.flatnonzero(label == k), int(quota[k])
        if wanted == cluster_kernels.AS_IT_IS:
            parents.append(cluster)
            weights.append(weight[cluster])
        else:
            parents.append(cluster[choose(weight[cluster], wanted, float(u[k]))])
            weights.append(np.full(wanted, mass[k] / wanted))
    index = np.concatenate(parents)
    return Placed(pose[index], label[index], np.concatenate(weights))
