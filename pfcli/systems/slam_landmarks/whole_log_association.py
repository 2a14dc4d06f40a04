"""Which detections of a log without ids are of the same landmark, decided over the whole log and taken back where it errs.

From coarse to fine: detections are blurred, so that what stands close together is one landmark; short tracks of detections are
landmarks of their own, and are merged by evidence, the map solved anew after each few (`landmark_merging`). The track that
follows is good enough to tell the landmarks of a group apart by the same means. At last every image is associated jointly with
the smoothed map (assignment problem, Kuhn 1955), landmarks that are hardly ever seen die, others are born, and all is repeated
until it stands. Odometry may be worse than it is said to be: each guess of that is a hypothesis, as is the filter's own
association, and the least smoothed cost decides.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from pfcli.core.geometry import compose
from pfcli.systems.slam_landmarks import landmark_smoother, sensor_calibration
from pfcli.systems.slam_landmarks.landmark_merging import Landmarks, same
from pfcli.systems.slam_landmarks.landmark_problem import Log, Options

NOTHING = -1
_COARSE_M, _FINE_M = 0.4, ((0.1, 0.3), (0.05, 0.2), (0.03, 0.2))
"""Blur of the first map; blur of the finer ones, and of the coarse landmarks that hold them together."""
_WORSE = (2.0, 1.0)
"""The odometry's spread in each hypothesis, in units of what it is said to be."""
_MOST = 300
"""A log of more short tracks than this keeps the filter's association: merging costs the cube of their number."""
_LOST_RAD, _TRACKED = 0.1, 9.0
"""A short track ends when the heading since its last detection is no better known; squared distance of its detections."""
_NONE = 25.0
"""A detection at this squared distance from every landmark is of nothing."""
_ROUNDS, _LEAST, _RARE = 12, 3, 0.03
"""Images are associated anew so often at the most; a landmark is seen so often at least, and where it could be seen, at least by
this share of what is usual."""
_TURNS = Options(learnt=tuple(name == "turn_scale" for name in sensor_calibration.NAMES))
"""An error of all turns alike displaces all places of a log together: it is learnt with them."""


class Associated(NamedTuple):
    """of (d,): landmark of each detection, NOTHING where it is of none; track (t, 3) and marks (l, 2) that it was decided with;
    cost: the smoothed one and that of all landmarks and detections of nothing."""

    of: NDArray[np.int64]
    track: NDArray[np.float64]
    marks: NDArray[np.float64]
    cost: float


def hypotheses(log: Log, track: NDArray[np.float64]) -> list[Associated]:
    """Associations of all detections of the log, the most probable one first; none for a log that is too long. of (d,) in the log
    and track (t, 3): those of the filter, a hypothesis of their own."""
    reckoned, nothing_off = _reckoned(log, track[0]), sensor_calibration.none()
    if int(_tracked(log, reckoned, _COARSE_M).max()) >= _MOST:
        return []
    cost = _area_cost(log, _points(log, track, nothing_off))
    found = [_standing(log, track, nothing_off, log.of.copy(), cost)]
    found += [_associated(log, reckoned, worse, cost) for worse in _WORSE]
    return sorted(found, key=lambda one: one.cost)


def _associated(log: Log, track: NDArray[np.float64], worse: float, area_cost: float) -> Associated:
    """One hypothesis, from the odometry's track (t, 3)."""
    calibration = sensor_calibration.none()
    loose = log._replace(step_sd=log.step_sd * [worse, worse, worse, 1.0])
    group = _tracked(loose, track, _COARSE_M)
    track, calibration, group = _merged(loose, track, calibration, group, (_COARSE_M, 0.0), np.zeros_like(group))
    of = group
    for blur, hold in _FINE_M:
        of = _tracked(log, track, blur)
        of = np.unique(np.column_stack([group, of]), axis=0, return_inverse=True)[1].ravel()
        track, calibration, of = _merged(log, track, calibration, of, (blur, hold), group)
    return _standing(log, track, calibration, of, area_cost)


def _reckoned(log: Log, first: NDArray[np.float64]) -> NDArray[np.float64]:
    """The track (t, 3) by the odometry alone, from the first pose (3,)."""
    track = np.tile(first, (log.step.shape[0] + 1, 1))
    for k, step in enumerate(log.step):
        track[k + 1] = compose(track[k : k + 1], step[None])[0]
    return track


def _points(log: Log, track: NDArray[np.float64], calibration: NDArray[np.float64]) -> NDArray[np.float64]:
    """(d, 2) where the detections are, seen from a track."""
    z, _ = sensor_calibration.corrected(log.z, log.step, calibration)
    angle = track[log.at, 2] + z[:, 1]
    return np.asarray(track[log.at, :2] + z[:, :1] * np.column_stack([np.cos(angle), np.sin(angle)]))


def _blurred(log: Log, blur_m: float) -> NDArray[np.float64]:
    """(d, 2) spread of detections of landmarks that are so wide."""
    across = blur_m / np.maximum(log.z[:, 0], 0.5)
    return np.column_stack([np.hypot(log.sd[:, 0], blur_m), np.hypot(log.sd[:, 1], across)])


class _Short:
    """A landmark while it is watched: where it is, when it was seen last, and its number."""

    def __init__(self, place: NDArray[np.float64], at: int, number: int) -> None:
        self.place, self.at, self.number = place, at, number

    def see(self, place: NDArray[np.float64], at: int) -> None:
        """The newest detections count most: the track drifts."""
        self.place, self.at = 0.8 * self.place + 0.2 * place, at


def _tracked(log: Log, track: NDArray[np.float64], blur_m: float) -> NDArray[np.int64]:
    """Labels (d,) of short tracks: detections that follow each other at one place before the heading is lost."""
    points, sd = _points(log, track, sensor_calibration.none()), _blurred(log, blur_m)
    direction = track[log.at, 2] + log.z[:, 1]
    along = np.column_stack([np.cos(direction), np.sin(direction)])
    turned = np.concatenate([[0.0], np.cumsum(log.step_sd[:, 2] ** 2)])
    of, watched, count = np.empty(log.at.size, np.int64), list[_Short](), 0
    for k, at in enumerate(log.at.tolist()):
        watched = [one for one in watched if turned[at] - turned[one.at] < _LOST_RAD**2]
        if watched:
            d = points[k] - np.array([one.place for one in watched])
            ahead, aside = d @ along[k], d[:, 1] * along[k, 0] - d[:, 0] * along[k, 1]
            squared = (ahead / sd[k, 0]) ** 2 + (aside / (log.z[k, 0] * sd[k, 1])) ** 2
            nearest = int(np.argmin(squared))
            if squared[nearest] < _TRACKED:
                watched[nearest].see(points[k], at)
                of[k] = watched[nearest].number
                continue
        watched.append(_Short(points[k], at, count))
        of[k], count = count, count + 1
    return of


def _merged(
    log: Log,
    track: NDArray[np.float64],
    calibration: NDArray[np.float64],
    of: NDArray[np.int64],
    blur: tuple[float, float],
    group: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Landmarks of a group merged, and the map solved anew, until none is the same as another. blur (m): of the landmarks, and of
    the groups that hold the track meanwhile (0: nothing does)."""
    sd, hold = _blurred(log, blur[0]), blur[1]
    pairs = _apart(log, blur[0])
    while True:
        count = int(of.max()) + 1
        tied = log._replace(of=of, sd=sd)
        if hold:
            tied = log._replace(
                at=np.concatenate([log.at, log.at]),
                of=np.concatenate([of, count + group]),
                z=np.concatenate([log.z, log.z]),
                sd=np.concatenate([sd, _blurred(log, hold)]),
            )
        marks = _middles(tied, track, calibration)
        found = landmark_smoother.solve(tied, track, marks, calibration, _TURNS, spread_of_marks=True)
        track, calibration = found.track, found.calibration
        mine = np.zeros(count, np.int64)
        mine[of] = group
        together = _together(of, pairs) + 1000 * (mine[:, None] != mine[None])
        label = same(Landmarks(found.marks[:count], found.marks_cov[: 2 * count, : 2 * count], together))
        if int(label.max()) + 1 == count:
            return track, calibration, of
        of = label[of]


def _apart(log: Log, blur_m: float) -> NDArray[np.int64]:
    """Pairs (k, 2) of detections of one image that are of different landmarks: farther apart than the blur explains."""
    points = log.z[:, :1] * np.column_stack([np.cos(log.z[:, 1]), np.sin(log.z[:, 1])])
    out = [np.empty((0, 2), np.int64)]
    start = np.searchsorted(log.at, np.arange(log.step.shape[0] + 2))
    most = int(np.diff(start).max(initial=0))
    for lag in range(1, most):
        first = np.arange(log.at.size - lag)
        first = first[log.at[first] == log.at[first + lag]]
        far = np.hypot(*(points[first] - points[first + lag]).T) > 3.0 * blur_m
        out.append(np.column_stack([first[far], first[far] + lag]))
    return np.concatenate(out)


def _together(of: NDArray[np.int64], pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """(l, l) how many pairs (k, 2) of detections, labelled (d,), are of both landmarks."""
    count = int(of.max()) + 1
    i, j = of[pairs[:, 0]], of[pairs[:, 1]]
    both = (i != j) & (i >= 0) & (j >= 0)
    out = np.zeros((count, count), np.int64)
    np.add.at(out, (i[both], j[both]), 1)
    return np.asarray(out + out.T)


def _middles(log: Log, track: NDArray[np.float64], calibration: NDArray[np.float64]) -> NDArray[np.float64]:
    """(l, 2) middles of the detections of each landmark."""
    points, seen = _points(log, track, calibration), np.maximum(np.bincount(log.of), 1)
    return np.column_stack([np.bincount(log.of, points[:, k]) / seen for k in (0, 1)])


def _standing(
    log: Log, track: NDArray[np.float64], calibration: NDArray[np.float64], of: NDArray[np.int64], area_cost: float
) -> Associated:
    """Images associated with the smoothed map until they stay with it."""
    pairs = _apart(log, 0.0)
    for last in range(_ROUNDS):
        good = of >= 0
        if not good.any():
            return Associated(of, track, np.empty((0, 2)), area_cost * of.size)
        of[good] = np.unique(of[good], return_inverse=True)[1]
        used = log._replace(at=log.at[good], of=of[good], z=log.z[good], sd=log.sd[good])
        marks = _middles(used, track, calibration)
        found = landmark_smoother.solve(used, track, marks, calibration, _TURNS, spread_of_marks=True)
        track, calibration = found.track, found.calibration
        label = same(Landmarks(found.marks, found.marks_cov, _together(of, pairs)))
        if int(label.max()) + 1 < label.size:
            of[good] = label[of[good]]
            continue
        alive = _alive(log, found.track, found.marks, np.bincount(used.of))
        fresh = _born(log, found, _joint(log, found, alive))
        if (fresh == of).all() or last == _ROUNDS - 1:
            break
        of = fresh
    nothing = float((of < 0).sum())
    return Associated(of, track, found.marks, found.cost + area_cost * (found.marks.shape[0] + nothing))


def _born(log: Log, found: landmark_smoother.Solution, of: NDArray[np.int64]) -> NDArray[np.int64]:
    """The labels, with new ones for detections of nothing that follow each other at one place."""
    left = np.flatnonzero(of < 0)
    if left.size == 0:
        return of
    rest = log._replace(at=log.at[left], z=log.z[left], sd=log.sd[left])
    label = _tracked(rest, found.track, 0.0)
    often = np.bincount(label)[label] >= _LEAST
    out = of.copy()
    out[left[often]] = int(of.max()) + 1 + label[often]
    return out


def _joint(log: Log, found: landmark_smoother.Solution, alive: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(d,) the landmark of each detection, each landmark once in an image, the least sum of squares; NOTHING beyond the gate."""
    of = np.full(log.at.size, NOTHING)
    landmarks = np.flatnonzero(alive)
    squares = np.full((log.at.size, landmarks.size), np.inf)
    for k, mark in enumerate(found.marks[landmarks]):
        every = np.broadcast_to(mark, (log.at.size, 2))
        errors = sensor_calibration.detection_errors(found.track[log.at], every, log.z, found.calibration)
        squares[:, k] = np.square(errors / log.sd).sum(axis=1)
    costs = np.minimum(squares, _NONE)
    start = np.searchsorted(log.at, np.arange(found.track.shape[0] + 1))
    for a, b in zip(start[:-1].tolist(), start[1:].tolist(), strict=True):
        if b - a == 1:
            rows, columns = np.array([0]), np.array([int(np.argmin(costs[a]))])
        elif b > a:
            rows, columns = linear_sum_assignment(costs[a:b])
        else:
            continue
        near = costs[a + rows, columns] < _NONE
        of[a + rows[near]] = landmarks[columns[near]]
    return of


def _alive(
    log: Log, track: NDArray[np.float64], marks: NDArray[np.float64], seen: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """(l,) landmarks that are seen about as often as others where they could be."""
    far, wide = np.quantile(log.z[:, 0], 0.9), np.quantile(np.abs(log.z[:, 1]), 0.95)
    share = np.empty(marks.shape[0])
    for k, mark in enumerate(marks):
        d = mark - track[:, :2]
        bearing = np.arctan2(d[:, 1], d[:, 0]) - track[:, 2]
        inside = (np.hypot(*d.T) < far) & (np.abs(np.arctan2(np.sin(bearing), np.cos(bearing))) < wide)
        share[k] = seen[k] / max(int(inside.sum()), int(seen[k]), 1)
    usual = float(np.average(share, weights=seen))
    alive = (seen >= _LEAST) & (share >= _RARE * usual)
    return alive if alive.any() else seen >= 1


def _area_cost(log: Log, places: NDArray[np.float64]) -> float:
    """What a landmark costs, and a detection of nothing, in squared standard deviations: twice the log of how many areas of a
    detection's spread lie where the places (d, 2) are."""
    area = float(np.prod(np.ptp(places, axis=0) + 1.0))
    spread = float(np.median(log.sd[:, 0] * log.sd[:, 1] * log.z[:, 0]))
    return 2.0 * max(1.0, math.log(area / (2.0 * math.pi * spread)))
