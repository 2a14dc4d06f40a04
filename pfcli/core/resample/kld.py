"""How many particles a belief needs: KLD-sampling (Fox 2003), with the bins of a systematic choice of ancestors."""

import numpy as np

from pfcli.core.jit import kernel
from pfcli.core.particles import pose_bin
from pfcli.core.resample.systematic import choose


@kernel
def bound(bins, error, z):
    """Particles that keep the Kullback-Leibler distance below `error` with the quantile `z`. Fox 2003, eq. (13)."""
    if bins <= 1:
        return 1
    a = 2.0 / (9.0 * (bins - 1))
    return int(np.ceil((bins - 1) / (2.0 * error) * (1.0 - a + np.sqrt(a) * z) ** 3))


@kernel
def occupied_bins(poses, chosen, side_m, side_rad):
    """Number of bins (side_m, side_m, side_rad) that the chosen poses fall into.

    poses: (n, 3); chosen: (m,), indices. Bins are hashed into 8 m slots: a rare collision counts one bin less.
    """
    size = 64
    while size < 8 * chosen.size:
        size *= 2
    seen = np.zeros(size, np.uint8)
    count, last = 0, -1
    for i in chosen:
        if i == last:
            continue
        last = i
        slot = pose_bin(poses, i, side_m, side_rad) & np.uint64(size - 1)
        if seen[slot] == 0:
            seen[slot] = 1
            count += 1
    return count


@kernel
def sample_size(poses, weights, cluster, u, least, limit, error, side_m, side_rad):
    """How many offspring of a cluster keep its spread: more are drawn on trial until the bound holds for what they hit.

    poses: (n, 3); weights: (n,); cluster: (m,), indices of these; u: offset of the draw in [0, 1); least, limit: fewest and
    most offspring; error: Kullback-Leibler distance that may be lost (0: always `limit`); side_m, side_rad: of a bin.
    """
    if error == 0.0:
        return limit
    # improbable hypotheses count as well: several draws for each member (one in 4 n of the weight may be missed)
    drawn = min(limit, max(4 * least, 4 * cluster.size))
    while True:
        bins = occupied_bins(poses, cluster[choose(weights[cluster], u, drawn)], side_m, side_rad)
        wanted = max(min(least, limit), bound(bins, error, 2.33))
        if wanted <= drawn or drawn == limit:
            return min(wanted, limit)
        drawn = min(limit, max(4 * drawn, wanted))
