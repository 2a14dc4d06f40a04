"""Places that the robot came back to, however far the path is off: each submap is looked for in all earlier ones.

A match counts only where several successive submaps agree on it: their matches, and the chain between them, close up. What lies
equally well elsewhere is left. Each closure that is accepted straightens the path, and the next is looked for less far.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.graph import submaps as sub
from pfcli.core.graph.pose_graph import Edges, Relaxed, no_edges, relax, softened
from pfcli.core.graph.submaps import Submap, Way
from pfcli.core.grid import scan_match
from pfcli.core.grid.pyramid import Place, Region, search
from pfcli.core.grid.scan_odometry import Setup, ends_of

_APART_M = 20.0
"""A place is come back to after so much way."""
_SIGMAS, _AT_LEAST_M, _AT_LEAST_RAD, _PER_M = 3.0, 1.0, 0.1, 0.01
"""Looked for within so many standard deviations of the path, and beyond by that much, and that share of the way between."""
_OVERLAP_M = 8.0
"""Two submaps whose middles are so far apart may show the same."""
_MOST = 24
_LEAST, _RIVAL = 0.55, 0.05
"""Mean likelihood of the points from which on a place is one; another one that is as good within the second makes it doubtful."""
_AROUND = (0.3, 0.3, 0.05)
"""What a place found by the search may be off (m, m, rad)."""
_FITS, _KNOWN = 0.7, 0.6
"""Shares of the end points on known map that lie on surfaces, and of all that lie on known map, from which on it is the place."""
_SURE, _TOLD_SD = 0.75, 0.1
"""A match of that score, told in all directions to that standard deviation (m), stands by its own scans."""
_AGREE, _BACK_M = 2, 24.0
"""So many others of the last metres must agree with a match."""
_OFF_M, _OFF_RAD, _OFF_PER_M = 0.5, 0.06, 0.015
"""Matches agree that close up within this, and that share of the way between them."""
_SCANS = (-3.0, -1.0, 1.0, 3.0)
"""Way from the middle of a group to those of its scans that are matched, m."""
_ENOUGH = 3
_EVERY = 2
"""One submap in so many is looked in: they overlap."""
_KNOWN_M = 6.0
"""Where the robot is known to be back, the next is looked for after so much way."""
_RIVAL_M = 1.5
_KEPT = 64
_DRAWS = 50
_STALE_M = 12.0
_CLOSURE_SD = (0.05, 0.05, 0.01)


class Closure(NamedTuple):
    """A submap that is seen again. earlier, later: submaps; seen (3,): the later one's middle from the earlier's; score: of the
    search; edges: of its scans."""

    earlier: int
    later: int
    seen: NDArray[np.float64]
    score: float
    edges: Edges

    @property
    def sure(self) -> bool:
        """Whether its scans need no other submap to agree: nearly all lies on surfaces, and these tell all directions."""
        return self.score >= _SURE and bool(np.linalg.eigvalsh(self.edges.information[:, :2, :2]).min() > _TOLD_SD**-2)


class Found(NamedTuple):
    """poses (t, 3) of all scans once the closures are closed; accepted; doubted: matches that nothing confirmed."""

    poses: NDArray[np.float64]
    accepted: list[Closure]
    doubted: list[Closure]


def find(way: Way, steps: Edges, setup: Setup, rng: np.random.Generator) -> Found:
    """All closures of a chain. steps: edges between its successive poses; rng: for what the path may be off."""
    submaps = sub.cut(way)
    if len(submaps) < 2:
        return Found(way.poses, [], [])
    finder = _Finder(submaps, way, steps, setup, rng)
    for later in range(len(finder.submaps)):
        finder.look(later)
    return finder.found()


class _Finder:
    """The submaps, what has been found, and the path of their middles that follows from it."""

    def __init__(self, submaps: list[Submap], way: Way, steps: Edges, setup: Setup, rng: np.random.Generator) -> None:
        self.submaps = submaps
        self._way, self._setup, self._rng = way, setup, rng
        self._chain = sub.chained(way, steps, self.submaps)
        self._middles = np.array([s.middle for s in self.submaps])
        self._along = way.along[self._middles]
        self._pyramid = lru_cache(_KEPT)(lambda k: sub.pyramid(way, self.submaps[k]))
        self._map = lru_cache(_KEPT)(lambda k: sub.drawn(way, self.submaps[k], setup.resolution_m))
        self._tried: list[Closure] = []
        self._accepted: list[Closure] = []
        self._path = self._relaxed()
        self._stale_m, self._next_m = 0.0, 0.0

    def look(self, later: int) -> None:
        """Look for a submap in all earlier ones that it may lie in."""
        if self._along[later] < self._next_m:
            return
        closure = self._closure(later)
        if closure is None:
            return
        agreeing = [c for c in self._tried if self._agree(c, closure)]
        self._tried.append(closure)
        if len(agreeing) < _AGREE and not closure.sure:
            return
        before, self._next_m = len(self._accepted), self._along[later] + _KNOWN_M
        self._accepted += [c for c in (*agreeing, closure) if not any(c is a for a in self._accepted)]
        if len(self._accepted) > before and (before == 0 or self._along[later] - self._stale_m > _STALE_M):
            self._path, self._stale_m = self._relaxed(), float(self._along[later])

    def found(self) -> Found:
        """What there is when all submaps were looked for."""
        relaxed = self._relaxed()
        way, middles = self._way, self._middles
        nearest = np.abs(self._along[None] - way.along[:, None]).argmin(axis=1)
        poses = compose(relaxed.poses[nearest], between(way.poses[middles[nearest]], way.poses))
        accepted = {id(c) for c in self._accepted}
        return Found(poses, self._accepted, [c for c in self._tried if id(c) not in accepted])

    def _relaxed(self) -> Relaxed:
        closures = self._accepted
        if not closures:
            doubtful = no_edges()
        else:
            # the scans of one group err alike: their mean information is that of the group
            first, second = (np.array([getattr(c, k) for c in closures]) for k in ("earlier", "later"))
            doubtful = Edges(
                first,
                second,
                np.array([c.seen for c in closures]),
                np.array([c.edges.information.mean(axis=0) for c in closures]),
            )
        start = self._path.poses if closures and hasattr(self, "_path") else self._way.poses[self._middles]
        return relax(start, self._chain, doubtful, self._rng, _DRAWS)

    def _closure(self, later: int) -> Closure | None:
        """The best match in the earlier submaps, if there is one, no other place is as good, and its scans agree."""
        path = self._path.poses
        earlier = np.arange(0, later, _EVERY)
        earlier = earlier[self._along[later] - self._along[earlier] > _APART_M]
        if earlier.size == 0:
            return None
        between_m = self._along[later] - self._along[earlier]
        sd = self._path.relative_sd(earlier, np.full(earlier.size, later))
        half = _SIGMAS * sd[:, 0] + _AT_LEAST_M + _PER_M * between_m
        turn = np.minimum(_SIGMAS * sd[:, 1] + _AT_LEAST_RAD, np.pi)
        away = np.hypot(*(path[earlier] - path[later])[:, :2].T)
        order = np.argsort(away, kind="stable")
        order = order[away[order] < half[order] + _OVERLAP_M][:_MOST]
        best, where = Place(np.zeros(3), -1.0), -1
        places: list[tuple[float, NDArray[np.float64]]] = []
        points = self.submaps[later].points
        for k in order.tolist():
            m = int(earlier[k])
            middle = between(path[m : m + 1], path[later : later + 1])[0]
            region = Region(middle, float(half[k]), float(turn[k]))
            least = max(_LEAST, best.score - _RIVAL)
            place = search(self._pyramid(m), points, region, least)
            if place.score < 0:
                continue
            places.append((place.score, compose(path[m : m + 1], place.pose[None])[0]))
            if place.score > best.score:
                best, where = place, m
        if where < 0:
            return None
        there = compose(path[where : where + 1], best.pose[None])[0]
        for score, pose in places:
            if np.hypot(*(pose - there)[:2]) > _RIVAL_M and score > best.score - _RIVAL:
                return None
        return self._matched(where, later, best)

    def _matched(self, earlier: int, later: int, place: Place) -> Closure | None:
        """Its scans matched one by one."""
        way, setup = self._way, self._setup
        middle, first = self.submaps[later].middle, self.submaps[earlier].middle
        near = np.diag(np.square(_AROUND) ** -1.0)
        seconds, measured, information, seen = [], [], [], []
        members = self.submaps[later].members
        for offset in _SCANS:
            k = int(members[np.argmin(np.abs(way.along[members] - way.along[middle] - offset))])
            step = between(way.poses[middle : middle + 1], way.poses[k : k + 1])
            prior = compose(place.pose[None], step)
            ends, maps = ends_of(way.scans[k]), self._map(earlier)
            match = scan_match.match(maps, prior, near, np.zeros((1, 3)), ends, setup.matcher)
            if (
                match.inliers[0] < _FITS
                or scan_match.known_share(maps, 0, match.pose[0], ends) < _KNOWN
                or k in seconds
            ):
                continue
            seconds.append(k)
            measured.append(match.pose[0])
            information.append(match.information[0] - near)
            seen.append(compose(match.pose, between(way.poses[k : k + 1], way.poses[middle : middle + 1]))[0])
        if len(seconds) < _ENOUGH:
            return None
        mean = np.median(np.array(seen), axis=0)
        edges = Edges(
            np.full(len(seconds), first),
            np.array(seconds),
            np.array(measured),
            softened(np.array(information), _CLOSURE_SD),
        )
        return Closure(earlier, later, mean, place.score, edges)

    def _agree(self, one: Closure, other: Closure) -> bool:
        """Whether two matches and the chain between them close up."""
        apart = abs(self._along[other.later] - self._along[one.later])
        back = abs(self._along[other.earlier] - self._along[one.earlier])
        if apart > _BACK_M or back > 2 * _BACK_M:
            return False
        poses = self._way.poses[self._middles]
        a, b, c, d = (poses[k][None] for k in (other.earlier, one.earlier, one.later, other.later))
        through = compose(compose(between(a, b), one.seen[None]), between(c, d))
        off = between(through, other.seen[None])[0]
        return bool(np.hypot(off[0], off[1]) < _OFF_M + _OFF_PER_M * (apart + back) and abs(off[2]) < _OFF_RAD)
