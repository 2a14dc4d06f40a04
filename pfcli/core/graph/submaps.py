"""Groups of scans of a few metres of way, as maps to look in and as what is looked for."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between
from pfcli.core.graph.pose_graph import Edges
from pfcli.core.grid import tiles
from pfcli.core.grid.pyramid import Pyramid, build
from pfcli.core.grid.scan_odometry import draw_one, ends_of

SPACING_M, HALF_M = 2.0, 4.0
"""Way between the middles of two submaps, and half the way whose scans make one."""
_CELL_M, _SPREAD_M = 0.1, 0.15
"""Grain of the search, and spread of an end point at that grain."""
_FAR_M = 30.0
"""Surfaces farther from the middle are left out of the search."""
_SCANS, _THIN_M, _POINTS = 9, 0.25, 120
"""Of a group so many scans make the points that are looked for, one in a square of that side, and so many at most."""


class Way(NamedTuple):
    """The chain to cut: scans, poses (t, 3) right as seen from those a few metres before, way (t,) m, fits (t,): scans that do
    not contradict what is drawn at those."""

    scans: list[tiles.Beams]
    poses: NDArray[np.float64]
    along: NDArray[np.float64]
    fits: NDArray[np.bool_]


class Submap(NamedTuple):
    """middle: the scan in whose frame all is seen; members (k,): scans; points (b, 2): what is looked for, m."""

    middle: int
    members: NDArray[np.int64]
    points: NDArray[np.float64]


def cut(way: Way) -> list[Submap]:
    """A submap for each `SPACING_M` of way; where no scan lies between two, they are one."""
    out: list[Submap] = []
    for at in np.arange(SPACING_M / 2, way.along[-1], SPACING_M):
        members = np.flatnonzero((np.abs(way.along - at) <= HALF_M) & way.fits)
        if members.size == 0:
            continue
        middle = int(members[np.argmin(np.abs(way.along[members] - at))])
        if out and out[-1].middle == middle:
            continue
        chosen = members[np.unique(np.linspace(0, members.size - 1, _SCANS).astype(np.int64))]
        out.append(Submap(middle, members, _thinned(_points(way, middle, chosen))))
    return out


def pyramid(way: Way, submap: Submap) -> Pyramid:
    """The submap to look in, in the frame of its middle."""
    return build(_points(way, submap.middle, submap.members), _SPREAD_M, _CELL_M)


def drawn(way: Way, submap: Submap, resolution_m: float) -> tiles.Tiles:
    """The submap to match in, in the frame of its middle."""
    maps = tiles.empty(1, resolution_m, 256)
    for k in submap.members.tolist():
        maps = draw_one(maps, _seen(way, submap.middle, k)[0], way.scans[k])
    return maps


def _seen(way: Way, middle: int, k: int) -> NDArray[np.float64]:
    return np.asarray(between(way.poses[middle : middle + 1], way.poses[k : k + 1]))


def _points(way: Way, middle: int, scans: NDArray[np.int64]) -> NDArray[np.float64]:
    """End points (n, 2) of some scans seen from the middle."""
    out = []
    for k in scans.tolist():
        (x, y, yaw), ends = _seen(way, middle, k)[0], ends_of(way.scans[k])
        cos, sin = np.cos(yaw), np.sin(yaw)
        out.append(np.stack([x + cos * ends[:, 0] - sin * ends[:, 1], y + sin * ends[:, 0] + cos * ends[:, 1]], axis=1))
    points = np.concatenate(out)
    near = np.abs(points).max(axis=1) < _FAR_M
    return np.asarray(points[near] if near.any() else points[:1])


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """One point of each square, so that all surfaces count alike; far from each other come first."""
    _, first = np.unique(np.floor(points / _THIN_M).astype(np.int64), axis=0, return_index=True)
    kept = points[np.sort(first)]
    step = -(-kept.shape[0] // _POINTS)
    thin = kept[::step]
    order = np.concatenate([np.arange(k, thin.shape[0], 8) for k in range(8)])
    return np.ascontiguousarray(thin[order])


def chained(way: Way, steps: Edges, submaps: list[Submap]) -> Edges:
    """Edges between successive submaps, from those between successive poses.

    An error of a step swings all that follows it.
    """
    middles = np.array([s.middle for s in submaps])
    measured = between(way.poses[middles[:-1]], way.poses[middles[1:]])
    covariance = np.linalg.inv(steps.information)
    total = np.empty((middles.size - 1, 3, 3))
    for e, (a, b) in enumerate(pairwise(middles)):
        seen = between(way.poses[a : a + 1], way.poses[a:b])
        rest = measured[e, :2] - between(way.poses[a : a + 1], way.poses[a + 1 : b + 1])[:, :2]
        cos, sin, by = np.cos(seen[:, 2]), np.sin(seen[:, 2]), np.zeros((b - a, 3, 3))
        by[:, 0, 0], by[:, 0, 1], by[:, 1, 0], by[:, 1, 1] = cos, -sin, sin, cos
        by[:, 0, 2], by[:, 1, 2], by[:, 2, 2] = -rest[:, 1], rest[:, 0], 1.0
        total[e] = (by @ covariance[a:b] @ by.swapaxes(1, 2)).sum(axis=0)
    first = np.arange(middles.size - 1)
    return Edges(first, first + 1, measured, np.asarray(np.linalg.inv(total), np.float64))
