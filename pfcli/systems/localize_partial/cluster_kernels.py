"""Kernels that only this paper needs: classes of moved particles, entries at frontiers, resampling by cluster."""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
from pfcli.core.grid.region import Region, clearance, crosses_wall, place_at
from pfcli.core.jit import kernel
from pfcli.core.resample.kld import sample_size
from pfcli.core.threads import spread

FIRST, LAST = 2, 6
AS_IT_IS = -1
WALL_FACTOR = 1e-3
"""What is left of a particle that moved through a wall."""


@kernel
def _move_rows(low, high, poses, classes, step, sd, z, place, to_wall, frame, moved, labels, factor):
    per_m2 = frame[0] * frame[0] + frame[3] * frame[3]
    for i in range(low, high):
        dx, dy = step[0] + sd[0] * z[i, 0], step[1] + sd[1] * z[i, 1]
        c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        x, y = poses[i, 0] + c * dx - s * dy, poses[i, 1] + s * dx + c * dy
        moved[i, 0], moved[i, 1], moved[i, 2] = x, y, wrap(poses[i, 2] + step[2] + sd[2] * z[i, 2])
        inside = place_at(place, frame, x, y) != 0
        if classes[i] == 4 or classes[i] == 5:
            labels[i] = 6 if inside else 5
        else:
            labels[i] = 3 if inside else 4
        clear = clearance(to_wall, frame, poses[i, 0], poses[i, 1])
        # most particles are far from all walls; to ask cell by cell costs as much as all the rest
        if clear * clear > per_m2 * (dx * dx + dy * dy) or not crosses_wall(
            place, frame, poses[i, 0], poses[i, 1], x, y
        ):
            factor[i] = 1.0
        else:
            factor[i] = WALL_FACTOR


def move(
    poses: NDArray[np.float64],
    classes: NDArray[np.uint8],
    step: NDArray[np.float64],
    sd: NDArray[np.float64],
    z: NDArray[np.float64],
    region: Region,
) -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.float64]]:
    """Poses after the step with noise, their classes by table 1, and what is left of each weight. Zhang 2010, section 2.

    poses: (n, 3); classes: uint8 (n,) of 2 .. 6; step, sd: (3,) m, m, rad; z: (n, 3) standard normal.
    A move through a wall leaves WALL_FACTOR of the weight, so that the map is left and entered at frontiers only.
    """
    n = poses.shape[0]
    moved, labels, factor = np.empty((n, 3)), np.empty(n, np.uint8), np.empty(n)
    grid = (region.place, region.to_wall, region.frame)
    spread(_move_rows, n, poses, classes, step, sd, z, *grid, moved, labels, factor, least=2000)
    return moved, labels, factor


@kernel
def entries(edge_xy, count, resolution_m, step, u, place, frame, strict):
    """Poses of robots that may just have come in: near a frontier, and outside before the step. Zhang 2010, definition 1.

    edge_xy: (e, 2), of which the first `count` cells are near sample_size; u: (n, 4) in [0, 1). strict: only headings with
    which the step came from outside, on a way free of walls. Returns (m, 3), m <= n.
    """
    out = np.empty((u.shape[0], 3))
    m = 0
    for i in range(u.shape[0]):
        k = min(int(u[i, 0] * count), count - 1)
        x = edge_xy[k, 0] + (u[i, 1] - 0.5) * resolution_m
        y = edge_xy[k, 1] + (u[i, 2] - 0.5) * resolution_m
        yaw = (u[i, 3] - 0.5) * 2 * np.pi
        before = yaw - step[2]
        c, s = np.cos(before), np.sin(before)
        px, py = x - (c * step[0] - s * step[1]), y - (s * step[0] + c * step[1])
        if strict and (place_at(place, frame, px, py) != 0 or crosses_wall(place, frame, px, py, x, y)):
            continue
        out[m, 0], out[m, 1], out[m, 2] = x, y, yaw
        m += 1
    return out[:m]


@kernel
def weigh(classes, weights, log_ratio, settled, most_against):
    """Weights (n,) after a scan, up to a factor exp(-top) that classes 4 and 5 and class 1 have too (eqs (13)-(23)).

    log_ratio: (n,) log likelihood over that outside, of the classes in the map; settled: log evidence that class 3 as a
    whole has at the least, -inf for none; most_against: what the scan may hold against the best particle of the map.
    Returns (weights, their sum, top, weight in the map before, after).
    """
    best = np.full(2, -np.inf)  # of class 3, and of the others in the map
    for i in range(classes.size):
        if classes[i] != 4 and classes[i] != 5:
            other = np.int64(classes[i] != 3)
            best[other] = max(best[other], log_ratio[i])
    out, before, after = np.empty(classes.size), np.zeros(2), np.zeros(2)
    for i in range(classes.size):
        if classes[i] != 4 and classes[i] != 5:
            other = np.int64(classes[i] != 3)
            out[i] = weights[i] * np.exp(log_ratio[i] - best[other])
            before[other] += weights[i]
            after[other] += out[i]
    rise = 0.0
    if after[0] > 0.0:
        rise = max(0.0, settled - best[0] - np.log(after[0] / before[0]))
    best[0] += rise
    highest = max(best[0], best[1])
    best += max(0.0, -most_against - highest) if highest > -np.inf else 0.0
    top = max(0.0, best[0], best[1])
    scale, outside, total = np.exp(best - top), np.exp(-top), 0.0
    for i in range(classes.size):
        if classes[i] == 4 or classes[i] == 5:
            out[i] = weights[i] * outside
        else:
            out[i] *= scale[np.int64(classes[i] != 3)]
        total += out[i]
    return out, total, top, before[0] + before[1], after[0] * scale[0] + after[1] * scale[1]


@kernel
def after_scan(classes, of_class, weights, log_ratio):
    """Indices (m,) of the particles of a class, and their weights (m,) after a scan, up to a factor."""
    best, count = -np.inf, 0
    for i in range(classes.size):
        if classes[i] == of_class:
            best, count = max(best, log_ratio[i]), count + 1
    index, after = np.empty(count, np.int64), np.empty(count)
    k = 0
    for i in range(classes.size):
        if classes[i] == of_class:
            index[k], after[k] = i, weights[i] * np.exp(log_ratio[i] - best)
            k += 1
    return index, after


@kernel
def together(poses, reach_m):
    """Share of the poses (n, 3) within reach of their median place."""
    x, y = np.median(poses[:, 0]), np.median(poses[:, 1])
    near = 0
    for i in range(poses.shape[0]):
        near += np.hypot(poses[i, 0] - x, poses[i, 1] - y) < reach_m
    return near / poses.shape[0]


@kernel
def flow(before, after, weights):
    """(7, 7): weight that went from each class to each (eqs (8)-(12), not yet divided by the source's weight)."""
    out = np.zeros((7, 7))
    for i in range(weights.size):
        out[before[i], after[i]] += weights[i]
    return out


@kernel
def masses(classes, weights):
    """(7,): weight of each class."""
    out = np.zeros(7)
    for i in range(weights.size):
        out[classes[i]] += weights[i]
    return out


@kernel
def worth(mass, most, least):
    """Particles that a share of the belief deserves: all from a tenth on, and `least` at the least."""
    return max(min(least, most), min(most, int(10.0 * mass * most)))


@kernel
def quotas(poses, classes, weights, u, least, lost, most, share, error, side_m, side_rad, negligible):
    """How many offspring each cluster gets: (7,), 0 where it is dropped, AS_IT_IS where it stays; and the clusters' weights (7,).

    poses: (n, 3); classes: (n,); weights: (n,), global; u: (7,), one offset per class; the others:
    `pfcli.systems.localize_partial.cluster_resampling.Limits`. Improbable clusters get fewer, and the outside classes 4 and 5 a
    tenth of `most` at the most.
    """
    n = poses.shape[0]
    sizes, mass, squares, limits = np.zeros(7, np.int64), np.zeros(7), np.zeros(7), np.zeros(7, np.int64)
    for i in range(n):
        k = classes[i]
        sizes[k] += 1
        mass[k] += weights[i]
        squares[k] += weights[i] * weights[i]
    # an entry starts with little weight and must live until the map has spoken: it keeps more than an exit, which odometry
    # alone tracks
    limits[2], limits[3] = worth(mass[2], most, lost), worth(mass[3], most, lost)
    limits[4] = worth(mass[4], max(min(least, most), most // 10), least)
    limits[5] = worth(mass[5], max(min(least, most), most // 10), least)
    limits[6] = worth(mass[6], most, least)
    out = np.zeros(7, np.int64)
    for k in range(FIRST, LAST + 1):
        if sizes[k] == 0 or mass[k] <= negligible:
            continue
        if sizes[k] <= limits[k] and mass[k] * mass[k] >= share * sizes[k] * squares[k]:
            out[k] = AS_IT_IS
            continue
        cluster = np.empty(sizes[k], np.int64)
        m = 0
        for i in range(n):
            if classes[i] == k:
                cluster[m] = i
                m += 1
        out[k] = sample_size(poses, weights, cluster, u[k], least, limits[k], error, side_m, side_rad)
    return out, mass
