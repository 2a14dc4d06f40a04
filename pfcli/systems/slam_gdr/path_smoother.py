"""The path as the whole log knows it: the best particle's, relaxed over all places that the robot came back to.

Three things are matched anew, against maps of a few metres of way, whose shape odometry and scans have hardly bent: each scan
against the map of the way just behind it, and against those of earlier visits; the odometry is calibrated on what comes
out. A pose graph holds them together (`core.pose_graph`). The path is taken only where scans
fit better into what other parts of the way drew.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.graph.pose_graph import Edges, Relaxed, relax
from pfcli.core.grid import scan_match, tiles
from pfcli.core.grid.coarse_search import coarse
from pfcli.core.grid.normals import scan_normals
from pfcli.core.grid.scan_odometry import TURN_M, WAY_M, ScanOdometry, Setup, draw_one, ends_of
from pfcli.core.motion.odometry import Noise
from pfcli.core.motion.odometry_calibration import Calibration, calibrate
from pfcli.rng import Purpose, rng_for

_APART_M = 10.0
"""A place is come back to after so much way."""
_NEAR_M = 3.0
"""Poses this near to each other, beyond what the path may be off, may have seen the same."""
_SIGMAS, _SURE_M, _WIDEST_M = 2.5, 0.3, 5.0
"""A place is looked for within so many standard deviations of the path; within the second without a coarse search; beyond the
third not at all, for there one corridor may be taken for another."""
_START_M, _YAW_RAD = 1.0, 0.3
"""The same at the start, on the filter's path, and half width of the search for the heading."""
_MOST = 4
"""Earlier visits that a scan is matched against, at most."""
_EVERY_M = (2.0, 1.0, 1.0)
"""One scan in so much way is matched against earlier visits: in the first round, that calibrates the odometry, in the second,
that finds what lies too far off without, and in the last, for accuracy."""
_FITS, _KNOWN = 0.7, 0.6
"""Shares of the end points on known map that lie on surfaces, and of all that lie on known map, from which on it is the place."""
_STEP_SD = (0.005, 0.005, 0.001)
_CLOSURE_SD = (0.02, 0.02, 0.003)
"""What a match errs by beyond its own information (m, m, rad)."""
_NOTHING = 1e-3
"""Information (1 / m^2, 1 / rad^2) that counts as none."""
_POLISH, _POLISH_SD = 2, (0.03, 0.03, 0.005)
"""How often all scans are matched against the map of all in the end, and how far each may move then (m, m, rad)."""
_DRAWS = 100
_NOWHERE = np.zeros(3)


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
    """path: poses of all updates, None where those that were given explain the scans better; fits (t,): scans that do not
    contradict the map of the way behind them; closures: matches with earlier visits; used: how many of them count;
    calibration of the odometry, None where it has hardly moved."""

    path: Relaxed | None
    fits: NDArray[np.bool_]
    closures: int
    used: int
    calibration: Calibration | None


class _Chain(NamedTuple):
    """poses (t, 3), each right as seen from those a few metres before; fits (t,): scans that do not contradict what is drawn at
    those; edges between successive poses."""

    poses: NDArray[np.float64]
    fits: NDArray[np.bool_]
    edges: Edges


def smooth(log: Log, given: NDArray[np.float64], setup: Setup) -> Smoothed:
    """The most probable path (t, 3) given the whole log, from one that lies near it."""
    steps = np.array(log.steps).reshape(-1, 3)
    # along a plain wall a scan says nothing: what pulls there is where the map happens to end
    matcher = setup.matcher._replace(map_normals=True, tangent=0.0)
    setup = setup._replace(matcher=matcher)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + TURN_M * np.abs(steps[:, 2]))])
    closures, calibration, relaxed = _none(), None, Relaxed(given, np.zeros((0, *given.shape)), np.zeros(0))
    for every_m in _EVERY_M:
        if calibration is None:
            chain = _chained(log, steps, setup.noise, way, setup)
        else:
            chain = _chained(log, calibration.corrected(steps), calibration.noise(), way, setup)
            relaxed = _relaxed(relaxed.poses, chain, closures)
        closures = _closures(log, relaxed, chain, way, setup, every_m)
        relaxed = _relaxed(relaxed.poses, chain, closures)
        calibration = calibrate(steps, between(relaxed.poses[:-1], relaxed.poses[1:]))
    for _ in range(_POLISH):
        relaxed = relaxed._replace(poses=_polished(log, relaxed.poses, chain.fits, setup))
    better = _explained(log, relaxed.poses, chain.fits, way, setup) > _explained(log, given, chain.fits, way, setup)
    used = int((relaxed.weights > 0.25).sum())
    return Smoothed(relaxed if better else None, chain.fits, closures.first.size, used, calibration)


def _relaxed(path: NDArray[np.float64], chain: _Chain, closures: Edges) -> Relaxed:
    # the end has no seed of its own, and needs none
    return relax(path, chain.edges, closures, rng_for(0, Purpose.SMOOTH, 0), _DRAWS)


def drawn(log: Log, poses: NDArray[np.float64], fits: NDArray[np.bool_], resolution_m: float) -> tiles.Tiles:
    """The map of the scans chosen by `fits` (t,) at poses (t, 3)."""
    maps = tiles.empty(1, resolution_m)
    for k in np.flatnonzero(fits).tolist():
        maps = draw_one(maps, poses[k], log.scans[k])
    return maps


def _polished(log: Log, poses: NDArray[np.float64], fits: NDArray[np.bool_], setup: Setup) -> NDArray[np.float64]:
    """Each scan matched against the map of all; the first pose stays."""
    maps = drawn(log, poses, fits, setup.resolution_m)
    near, out = np.diag(np.square(_POLISH_SD) ** -1.0), poses.copy()
    for k in range(1, len(poses)):
        out[k] = _match(maps, poses[k : k + 1], near, ends_of(log.scans[k]), _NOWHERE, setup).pose[0]
    return out


def _explained(
    log: Log, poses: NDArray[np.float64], fits: NDArray[np.bool_], way: NDArray[np.float64], setup: Setup
) -> float:
    """Mean log likelihood of an end point in a map of scans from other parts of the way: its own fits wherever it is drawn."""
    m, part = setup.matcher, np.floor(way / _APART_M).astype(np.int64) % 2
    maps = [drawn(log, poses, fits & (part == other), setup.resolution_m) for other in (1, 0)]
    total, count = 0.0, 0
    for scan, pose, mine in zip(log.scans, poses, part, strict=True):
        ends = ends_of(scan)
        normals = scan_normals(ends, m.beam_width_rad / m.sigma_m)
        total += float(scan_match.log_likelihood(maps[mine], 0, pose, ends, normals, m.sigma_m, m, 1))
        count += ends.shape[0]
    return total / max(1, count)


def _match(
    maps: tiles.Tiles,
    prior: NDArray[np.float64],
    known: NDArray[np.float64],
    ends: NDArray[np.float64],
    elsewhere: NDArray[np.float64],
    setup: Setup,
) -> scan_match.Match:
    """Match a scan near the pose `prior` (1, 3), of which as much is known (3, 3), and from a second start."""
    return scan_match.match(maps, prior, known, elsewhere[None], ends, setup.matcher)


def _softened(information_of: NDArray[np.float64], sd: tuple[float, float, float]) -> NDArray[np.float64]:
    """Information (e, 3, 3) after errors of that standard deviation were added. What it has of a direction may be nothing, as
    along a plain wall; it comes out positive definite."""
    values, axes = np.linalg.eigh((information_of + information_of.swapaxes(1, 2)) / 2)
    covariance = (axes / np.maximum(values, _NOTHING)[:, None, :]) @ axes.swapaxes(1, 2)
    return np.asarray(np.linalg.inv(covariance + np.diag(np.square(sd))))


def _seen_from(headings: NDArray[np.float64], information_of: NDArray[np.float64]) -> NDArray[np.float64]:
    """Information (e, 3, 3) in the map frame as in the frames of poses with such headings (e,)."""
    cos, sin, turn = np.cos(headings), np.sin(headings), np.zeros((headings.size, 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = cos, -sin, sin, cos, 1.0
    return np.asarray(turn.swapaxes(1, 2) @ information_of @ turn)


def _chained(log: Log, steps: NDArray[np.float64], noise: Noise, way: NDArray[np.float64], setup: Setup) -> _Chain:
    """Match each scan against the map of the way behind it. noise: of the steps (t - 1, 3) while the wheels do not slip."""
    poses, information_of, fits = np.zeros((way.size, 3)), np.empty((way.size - 1, 3, 3)), np.ones(way.size, np.bool_)
    behind = ScanOdometry(setup, log.scans[0], poses[0])
    for k in range(1, way.size):
        poses[k], information_of[k - 1], fits[k] = behind.step(log.scans[k], steps[k - 1], way[k] - way[k - 1], noise)
    first = np.arange(way.size - 1)
    told = _softened(_seen_from(poses[:-1, 2], information_of), _STEP_SD)
    return _Chain(poses, fits, Edges(first, first + 1, between(poses[:-1], poses[1:]), told))


def _none() -> Edges:
    return Edges(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3, 3)))


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


def _closures(
    log: Log, relaxed: Relaxed, chain: _Chain, way: NDArray[np.float64], setup: Setup, every_m: float
) -> Edges:
    """Matches with earlier visits."""
    path, pairs, drawn_at = relaxed.poses, _visits(relaxed, way, every_m), np.nan
    kept, measured, information_of = [], [], []
    for p, (j, i, middle, half) in enumerate(zip(*pairs, strict=True)):
        if middle != drawn_at:
            part = chain.fits & (np.abs(way - middle) <= WAY_M)
            maps, drawn_at = drawn(log, chain.poses, part, setup.resolution_m), middle
        prior = compose(chain.poses[j : j + 1], between(path[j : j + 1], path[i : i + 1]))
        ends, elsewhere = ends_of(log.scans[i]), _NOWHERE
        if half > _SURE_M:
            window = setup.window._replace(half_xy_m=float(half), half_yaw_rad=_YAW_RAD)
            elsewhere = coarse(maps, 0, prior[0], ends, window)
        around = np.diag([half**-2, half**-2, _YAW_RAD**-2])
        match = _match(maps, prior, around, ends, elsewhere, setup)
        if match.inliers[0] >= _FITS and scan_match.known_share(maps, 0, match.pose[0], ends) >= _KNOWN:
            kept.append(p)
            measured.append(between(chain.poses[j : j + 1], match.pose)[0])
            # where it was looked for is no evidence
            information_of.append(match.information[0] - around)
    first, second = pairs.first[kept], pairs.second[kept]
    told = _seen_from(chain.poses[first, 2], np.array(information_of).reshape(-1, 3, 3))
    return Edges(first, second, np.array(measured).reshape(-1, 3), _softened(told, _CLOSURE_SD))
