"""Scans matched against maps of earlier visits that lie near the path."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.graph.pose_graph import Edges, Relaxed, seen_from, softened
from pfcli.core.grid import scan_match, tiles
from pfcli.core.grid.coarse_search import coarse
from pfcli.core.grid.scan_odometry import WAY_M, Setup, drawn, ends_of
from pfcli.systems.slam_gdr.scan_chain import Chain

_APART_M = 10.0
"""A place is come back to after so much way."""
_NEAR_M = 3.0
"""Poses this near to each other, beyond what the path may be off, may have seen the same."""
_SIGMAS, _SURE_M, _WIDEST_M = 2.5, 0.3, 5.0
"""A place is looked for within so many standard deviations of the path; within the second without a coarse search; beyond the
third not at all, for there one corridor may be taken for another."""
_START_M, _YAW_RAD = 1.0, 0.3
"""The same where the path says nothing of what it may be off, and half width of the search for the heading."""
_MOST = 4
"""Earlier visits that a scan is matched against, at most."""
_FITS, _KNOWN = 0.7, 0.6
"""Shares of the end points on known map that lie on surfaces, and of all that lie on known map, from which on it is the place."""
_CLOSURE_SD = (0.02, 0.02, 0.003)
"""What a match errs by beyond its own information (m, m, rad)."""
_NOWHERE = np.zeros(3)


class _Visits(NamedTuple):
    """Pairs of scans to match, sorted by map: second (p,), first (p,) the nearest pose of an earlier visit, middle (p,) of the
    way whose scans make the map (m), half (p,), how far off it may be (m)."""

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    middle: NDArray[np.float64]
    half: NDArray[np.float64]


def _visits(relaxed: Relaxed, way: NDArray[np.float64], every_m: float) -> _Visits:
    """What to match: of each scan that is asked the nearest `_MOST` visits, however often the robot comes by."""
    path, rows = relaxed.poses, []
    asked = np.flatnonzero(np.diff(np.floor(way / every_m), prepend=-1.0) > 0)
    for middle in np.arange(WAY_M / 2, way[-1] - _APART_M, WAY_M):
        visit = np.flatnonzero(np.abs(way - middle) <= WAY_M)
        later = asked[way[asked] > middle + WAY_M + _APART_M]
        if visit.size == 0 or later.size == 0:
            continue
        away = np.hypot(*(path[later, :2] - path[visit[visit.size // 2], :2]).T)
        later = later[away < _NEAR_M + _WIDEST_M + 2 * WAY_M]
        square = ((path[later, None, :2] - path[None, visit, :2]) ** 2).sum(axis=2)
        nearest = visit[square.argmin(axis=1)]
        half = np.full(later.size, _START_M)
        if relaxed.draws.size:
            half = np.maximum(_SIGMAS * relaxed.relative_sd(nearest, later)[:, 0], _SURE_M)
        far = np.sqrt(square.min(axis=1))
        # each earlier pose lies in the middle of one map
        near = (half <= _WIDEST_M) & (far < _NEAR_M + half) & (np.abs(way[nearest] - middle) <= WAY_M / 2)
        rows.append(np.stack([later, nearest, np.full(later.size, middle), half, far], axis=1)[near])
    pairs = np.concatenate(rows) if rows else np.empty((0, 5))
    pairs = pairs[np.lexsort((pairs[:, 4], pairs[:, 0]))]
    start = np.searchsorted(pairs[:, 0], pairs[:, 0])
    pairs = pairs[np.arange(len(pairs)) - start < _MOST]
    pairs = pairs[np.argsort(pairs[:, 2], kind="stable")]
    return _Visits(pairs[:, 1].astype(np.int64), pairs[:, 0].astype(np.int64), pairs[:, 2], pairs[:, 3])


def revisits(
    scans: list[tiles.Beams], relaxed: Relaxed, chain: Chain, way: NDArray[np.float64], setup: Setup, every_m: float
) -> Edges:
    """Matches with earlier visits."""
    path, pairs, drawn_at = relaxed.poses, _visits(relaxed, way, every_m), np.nan
    kept, measured, information_of = [], [], []
    for p, (j, i, middle, half) in enumerate(zip(*pairs, strict=True)):
        if middle != drawn_at:
            part = chain.fits & (np.abs(way - middle) <= WAY_M)
            maps, drawn_at = drawn(scans, chain.poses, part, setup.resolution_m), middle
        prior = compose(chain.poses[j : j + 1], between(path[j : j + 1], path[i : i + 1]))
        ends, elsewhere = ends_of(scans[i]), _NOWHERE
        if half > _SURE_M:
            window = setup.window._replace(half_xy_m=float(half), half_yaw_rad=_YAW_RAD)
            elsewhere = coarse(maps, 0, prior[0], ends, window)
        around = np.diag([half**-2, half**-2, _YAW_RAD**-2])
        match = scan_match.match(maps, prior, around, elsewhere[None], ends, setup.matcher)
        if match.inliers[0] >= _FITS and scan_match.known_share(maps, 0, match.pose[0], ends) >= _KNOWN:
            kept.append(p)
            measured.append(between(chain.poses[j : j + 1], match.pose)[0])
            # where it was looked for is no evidence
            information_of.append(match.information[0] - around)
    first, second = pairs.first[kept], pairs.second[kept]
    told = seen_from(chain.poses[first, 2], np.array(information_of).reshape(-1, 3, 3))
    return Edges(first, second, np.array(measured).reshape(-1, 3), softened(told, _CLOSURE_SD))
