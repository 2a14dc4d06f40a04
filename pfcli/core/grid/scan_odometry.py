"""Odometry from scans: each is matched against the map of the way just behind it, whose shape has hardly had time to bend."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import compose
from pfcli.core.grid import scan_match, tiles
from pfcli.core.grid.coarse_search import Window, coarse
from pfcli.core.motion.odometry import Noise, information

WAY_M = 4.0
"""Half the way whose scans make a map to match against."""
TURN_M = 0.3
"""A radian turned counts as so much way."""
_PEOPLE = 8.0
"""By so many nats a slip must explain a scan better: people who walk along together look like a few."""
_NOWHERE = np.zeros(3)


class Setup(NamedTuple):
    """What is matched with: matcher, coarse search, noise of the odometry, cell (m), share of end points on surfaces below
    which a scan is not drawn."""

    matcher: scan_match.Matcher
    window: Window
    noise: Noise
    resolution_m: float
    draw_inliers: float


class Matched(NamedTuple):
    """pose (3,) in the frame of the first one; information (3, 3) of its step, map frame; fits: the scan does not contradict
    the map of the way behind it."""

    pose: NDArray[np.float64]
    information: NDArray[np.float64]
    fits: bool


class ScanOdometry:
    """The pose by scans and odometry, and the maps of the last metres: at least `WAY_M` of way, at most twice as much."""

    def __init__(self, setup: Setup, first: tiles.Beams, pose: NDArray[np.float64]) -> None:
        self._setup = setup
        self.pose = pose
        self._older = draw_one(tiles.empty(1, setup.resolution_m), self.pose, first)
        self._newer: tiles.Tiles | None = None
        self._way_m, self._since_m = 0.0, 0.0

    def step(
        self, scan: tiles.Beams, moved: NDArray[np.float64], way_m: float, noise: Noise, slips: bool = True
    ) -> Matched:
        """Take the step `moved` (3,) of the odometry, after so much way, and match the scan.

        noise: of the step while the wheels do not slip; where they seem to, the odometry is taken for what it may be; slips:
        whether they may.
        """
        return self.take(scan, self.matched(scan, moved, noise, slips), way_m)

    @property
    def map(self) -> tiles.Tiles:
        """The map of the way behind."""
        return self._older

    def matched(
        self, scan: tiles.Beams, moved: NDArray[np.float64], noise: Noise, slips: bool = True
    ) -> scan_match.Match:
        """Match the scan after the step `moved` (3,); see `step`."""
        setup, ends = self._setup, ends_of(scan)
        prior = compose(self.pose[None], moved[None])
        known = information(moved, noise)
        match = scan_match.match(self._older, prior, known, _NOWHERE[None], ends, setup.matcher)
        elsewhere = coarse(self._older, 0, prior[0], ends, setup.window) if slips else _NOWHERE
        if elsewhere.any():
            # the wheels may have slipped: then odometry is as bad as the parameters allow, or says nothing
            usual = information(moved, setup.noise)
            other = scan_match.match(self._older, prior, usual, elsewhere[None], ends, setup.matcher)
            before = scan_match.log_prior(other.pose[0], prior[0], known, setup.matcher)
            if other.log_likelihood[0] + before > match.log_likelihood[0] + match.log_prior[0] + _PEOPLE:
                match = other
        return match

    def take(self, scan: tiles.Beams, match: scan_match.Match, way_m: float) -> Matched:
        """Go to where the scan was matched, after so much way, and draw it where it does not contradict the map."""
        setup = self._setup
        self.pose = match.pose[0]
        self._way_m += way_m
        if self._newer is None and self._way_m - self._since_m >= WAY_M:
            self._newer = tiles.empty(1, setup.resolution_m)
        fits = not 0.0 <= match.inliers[0] < setup.draw_inliers
        if fits:
            self._older = draw_one(self._older, self.pose, scan)
            self._newer = None if self._newer is None else draw_one(self._newer, self.pose, scan)
        if self._newer is not None and self._way_m - self._since_m >= 2 * WAY_M:
            self._older, self._newer, self._since_m = self._newer, None, self._way_m - WAY_M
        return Matched(self.pose, match.information[0], fits)


def ends_of(scan: tiles.Beams) -> NDArray[np.float64]:
    """End points (b, 2) on surfaces in the base frame (m); they come first in a scan of `tiles.Beams`."""
    return scan.ends[: int(scan.hit.sum())]


def draw_one(maps: tiles.Tiles, pose: NDArray[np.float64], scan: tiles.Beams) -> tiles.Tiles:
    """Draw a scan into the map of a single particle, at a pose (3,)."""
    return tiles.draw(maps, pose[None], np.ones(1, bool), scan)


def drawn(
    scans: list[tiles.Beams], poses: NDArray[np.float64], chosen: NDArray[np.bool_], resolution_m: float
) -> tiles.Tiles:
    """The map of the scans chosen (t,) of t, at poses (t, 3)."""
    maps = tiles.empty(1, resolution_m)
    for k in np.flatnonzero(chosen).tolist():
        maps = draw_one(maps, poses[k], scans[k])
    return maps
