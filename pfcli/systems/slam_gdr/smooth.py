"""The path as the whole log knows it: the best particle's, relaxed over all places that the robot came back to.

Three things are matched anew, against maps of a few metres of way, whose shape odometry and scans have hardly bent: each scan
against the map of the way just behind it, and against those of earlier visits; the odometry is calibrated on what comes
out. A pose graph holds them together (`core.pose_graph`).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.grid import scan_match, tiles
from pfcli.core.motion.calibration import Calibration, calibrate
from pfcli.core.motion.odometry import Noise, information
from pfcli.core.pose_graph import Edges, Relaxed, relax
from pfcli.rng import Purpose, rng_for

_TURN_M = 0.3
"""A radian turned counts as so much way."""
_WAY_M = 4.0
"""Half the way whose scans make a map to match against."""
_APART_M = 10.0
"""A place is come back to after so much way."""
_NEAR_M = 4.0
"""Poses this near to each other may have seen the same."""
_EVERY_M = 1.0
"""One scan in so much way is matched against earlier visits."""
_WINDOW_M, _DRIFT, _WIDEST_M, _YAW_RAD = 1.0, 0.01, 3.0, 0.3
"""Half width of the search for a place again: at least, per way since, at most; and of its heading."""
_AGAIN_M = 0.5
"""The same once the path has been relaxed."""
_FITS, _KNOWN = 0.7, 0.6
"""Shares of the end points on known map that lie on surfaces, and of all that lie on known map, from which on it is the place."""
_STEP_SD = (0.005, 0.005, 0.001)
_CLOSURE_SD = (0.02, 0.02, 0.003)
"""What a match errs by beyond its own information (m, m, rad)."""
_DRAWS = 100


class Setup(NamedTuple):
    """What the filter matches with: matcher, coarse search, its gain and beams, noise of the odometry, cell (m), share of end
    points on surfaces below which a scan is not drawn."""

    matcher: scan_match.Matcher
    window: scan_match.Window
    coarse_gain: float
    coarse_beams: int
    noise: Noise
    resolution_m: float
    draw_inliers: float


class Log:
    """The scans of all updates, and the odometry between them."""

    def __init__(self) -> None:
        self.scans: list[tiles.Beams] = []
        self.steps: list[NDArray[np.float64]] = []

    def add(self, scan: tiles.Beams, step: NDArray[np.float64] | None) -> None:
        """An update: its scan, and the step (3,) that led to it; None for the first."""
        self.scans.append(scan)
        if step is not None:
            self.steps.append(step)


class Smoothed(NamedTuple):
    """path: poses and covariances of all updates; closures: matches with earlier visits, and how many of them count;
    calibration of the odometry, None where it has hardly moved."""

    path: Relaxed
    closures: int
    used: int
    calibration: Calibration | None


class _Chain(NamedTuple):
    """poses (t, 3), each right as seen from those a few metres before; edges between successive ones."""

    poses: NDArray[np.float64]
    edges: Edges


def smooth(log: Log, path: NDArray[np.float64], setup: Setup) -> Smoothed:
    """The most probable path (t, 3) given the whole log, from one that lies near it."""
    steps = np.array(log.steps).reshape(-1, 3)
    # along a plain wall a scan says nothing: what pulls there is where the map happens to end
    matcher = setup.matcher._replace(map_normals=True, tangent=0.0)
    setup = setup._replace(matcher=matcher)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + _TURN_M * np.abs(steps[:, 2]))])
    chain = _chained(log, steps, way, setup)
    path = relax(path, chain.edges, _closures(log, path, chain, way, setup, searching=True)).poses
    calibration = calibrate(steps, between(path[:-1], path[1:]))
    if calibration is not None:
        chain = _chained(log, calibration.corrected(steps), way, setup._replace(noise=calibration.noise()))
    closures = _closures(log, path, chain, way, setup, searching=False)
    # the end has no seed of its own, and needs none
    relaxed = relax(path, chain.edges, closures, rng_for(0, Purpose.SMOOTH, 0), _DRAWS)
    return Smoothed(relaxed, closures.first.size, int((relaxed.weights > 0.25).sum()), calibration)


def drawn(log: Log, poses: NDArray[np.float64], resolution_m: float) -> tiles.Tiles:
    """The map of all scans at poses (t, 3)."""
    maps = tiles.empty(1, resolution_m)
    for scan, pose in zip(log.scans, poses, strict=True):
        maps = _draw(maps, pose, scan)
    return maps


def _draw(maps: tiles.Tiles, pose: NDArray[np.float64], scan: tiles.Beams) -> tiles.Tiles:
    return tiles.draw(maps, pose[None], np.ones(1, bool), scan)


def _ends(scan: tiles.Beams) -> NDArray[np.float64]:
    """End points on surfaces, which come first."""
    return scan.ends[: int(scan.hit.sum())]


def _matched(
    maps: tiles.Tiles,
    prior: NDArray[np.float64],
    prior_information: NDArray[np.float64],
    ends: NDArray[np.float64],
    window: scan_match.Window,
    setup: Setup,
) -> scan_match.Match:
    """Match a scan near the pose `prior` (1, 3)."""
    thinned = ends[:: max(1, ends.shape[0] // setup.coarse_beams)].copy()
    correction = scan_match.coarse(maps, 0, prior[0], thinned, window, setup.coarse_gain)
    return scan_match.match(maps, prior, prior_information, correction[None], ends, setup.matcher)


def _softened(information_of: NDArray[np.float64], sd: tuple[float, float, float]) -> NDArray[np.float64]:
    """Information (e, 3, 3), which may be singular, after errors of that standard deviation were added."""
    return np.asarray(
        information_of
        - information_of @ np.linalg.solve(information_of + np.diag(np.square(sd) ** -1.0), information_of)
    )


def _chained(log: Log, steps: NDArray[np.float64], way: NDArray[np.float64], setup: Setup) -> _Chain:
    """Match each scan against the map of the way behind it: at least `_WAY_M` of it, at most twice as much."""
    poses, information_of = np.zeros((way.size, 3)), np.empty((way.size - 1, 3, 3))
    older, newer, since = _draw(tiles.empty(1, setup.resolution_m), poses[0], log.scans[0]), None, 0.0
    for k in range(1, way.size):
        prior = compose(poses[k - 1 : k], steps[k - 1 : k])
        match = _matched(older, prior, information(steps[k - 1], setup.noise), _ends(log.scans[k]), setup.window, setup)
        poses[k], information_of[k - 1] = match.pose[0], match.information[0]
        if newer is None and way[k] - since >= _WAY_M:
            newer = tiles.empty(1, setup.resolution_m)
        if not 0.0 <= match.inliers[0] < setup.draw_inliers:
            older = _draw(older, poses[k], log.scans[k])
            newer = None if newer is None else _draw(newer, poses[k], log.scans[k])
        if newer is not None and way[k] - since >= 2 * _WAY_M:
            older, newer, since = newer, None, way[k] - _WAY_M
    first = np.arange(way.size - 1)
    return _Chain(poses, Edges(first, first + 1, between(poses[:-1], poses[1:]), _softened(information_of, _STEP_SD)))


def _closures(
    log: Log, path: NDArray[np.float64], chain: _Chain, way: NDArray[np.float64], setup: Setup, searching: bool
) -> Edges:
    """Matches with earlier visits. searching: the path may be off by what drifts over a long way."""
    asked = np.flatnonzero(np.diff(np.floor(way / _EVERY_M), prepend=-1.0) > 0)
    first, second, measured, information_of = [], [], [], []
    for middle in np.arange(_WAY_M / 2, way[-1] - _APART_M, _WAY_M):
        visit = np.flatnonzero(np.abs(way - middle) <= _WAY_M)
        later = asked[way[asked] > middle + _WAY_M + _APART_M]
        if visit.size == 0 or later.size == 0:
            continue
        square = ((path[later, None, :2] - path[None, visit, :2]) ** 2).sum(axis=2)
        nearest = visit[square.argmin(axis=1)]
        # each earlier pose lies in the middle of one such map
        chosen = (square.min(axis=1) < _NEAR_M**2) & (np.abs(way[nearest] - middle) <= _WAY_M / 2)
        if not chosen.any():
            continue
        maps = tiles.empty(1, setup.resolution_m)
        for k in visit:
            maps = _draw(maps, chain.poses[k], log.scans[k])
        for j, i in zip(nearest[chosen], later[chosen], strict=True):
            half = float(np.clip(_DRIFT * (way[i] - way[j]), _WINDOW_M, _WIDEST_M)) if searching else _AGAIN_M
            prior = compose(chain.poses[j : j + 1], between(path[j : j + 1], path[i : i + 1]))
            window = setup.window._replace(half_xy_m=half, half_yaw_rad=_YAW_RAD)
            ends = _ends(log.scans[i])
            around = np.diag([half**-2, half**-2, _YAW_RAD**-2])
            match = _matched(maps, prior, around, ends, window, setup)
            if match.inliers[0] >= _FITS and scan_match.known_share(maps, 0, match.pose[0], ends) >= _KNOWN:
                first.append(j)
                second.append(i)
                measured.append(between(chain.poses[j : j + 1], match.pose)[0])
                information_of.append(match.information[0] - around)
    return Edges(
        np.array(first, np.int64),
        np.array(second, np.int64),
        np.array(measured).reshape(-1, 3),
        _softened(np.array(information_of).reshape(-1, 3, 3), _CLOSURE_SD),
    )
