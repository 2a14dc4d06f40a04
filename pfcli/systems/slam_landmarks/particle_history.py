"""All that was driven and seen, by particle, and what follows from it as a whole."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.landmark_store import FIELDS
from pfcli.systems.slam_landmarks import landmark_smoother
from pfcli.systems.slam_landmarks.landmark_problem import Log, Options
from pfcli.systems.slam_landmarks.landmarks_given_tracks import given_tracks
from pfcli.systems.slam_landmarks.usable_detections import View


class Middle(NamedTuple):
    """The last solution: track (t, 3), and places (l, 2) of the landmarks of columns (l,)."""

    track: NDArray[np.float64]
    columns: NDArray[np.int64]
    places: NDArray[np.float64]


class History(NamedTuple):
    """By observation: step and its spread, detections (z, sd), and columns (n, m), or (1, m) where all agree, that each particle
    took for them. Tracks: `settled` (n, t, 3) of the particles that were drawn anew last, around the `middle`; since then poses
    (n, 3) of each observation and, where particles were resampled after it, their parents (n,)."""

    step: list[NDArray[np.float64]]
    step_sd: list[NDArray[np.float64]]
    z: list[NDArray[np.float64]]
    sd: list[NDArray[np.float64]]
    column: list[NDArray[np.int32]]
    settled: NDArray[np.float64]
    middle: Middle
    pose: list[NDArray[np.float64]]
    parents: list[NDArray[np.int64] | None]


class Past(NamedTuple):
    """What one particle drove and saw: the problem, its track (t, 3), its landmarks (l, 2) and their columns (l,), and which
    columns it took for each observation."""

    log: Log
    track: NDArray[np.float64]
    places: NDArray[np.float64]
    columns: NDArray[np.int64]
    taken: list[NDArray[np.int32]]


def empty() -> History:
    """Nothing driven, nothing seen."""
    return History(
        step=[],
        step_sd=[],
        z=[],
        sd=[],
        column=[],
        settled=np.empty((1, 0, 3)),
        middle=Middle(np.empty((0, 3)), np.empty(0, np.int64), np.empty((0, 2))),
        pose=[],
        parents=[],
    )


def record(
    history: History,
    step: NDArray[np.float64],
    step_sd: NDArray[np.float64],
    view: View,
    column: NDArray[np.int32],
    pose: NDArray[np.float64],
) -> None:
    """Take note of an observation: the step (3,) to it and its spread (4,), its detections, the columns (n, m) or (1, m) that the
    particles took for them, and the poses (n, 3)."""
    history.step.append(step)
    history.step_sd.append(step_sd)
    history.z.append(view.z)
    history.sd.append(np.sqrt(view.noise))
    history.column.append(column)
    history.pose.append(pose)
    history.parents.append(None)


def choose(history: History, ancestors: NDArray[np.int64]) -> None:
    """The particles were resampled after the last observation."""
    history.parents[-1] = ancestors


def of_particle(history: History, i: int, marks: NDArray[np.float64]) -> Past:
    """The past of particle i, whose landmarks are marks (l, FIELDS); those without sightings are none."""
    count, settled = len(history.z), history.settled.shape[1]
    column: list[NDArray[np.int32]] = [np.empty(0, np.int32)] * count
    track = np.empty((count, 3))
    for k in range(count - 1, settled - 1, -1):
        parents = history.parents[k - settled]
        i = i if parents is None else int(parents[i])
        track[k], column[k] = history.pose[k - settled][i], history.column[k][i]
    track[:settled] = history.settled[i if settled else 0]
    column[:settled] = [rows[0] for rows in history.column[:settled]]
    alive = np.flatnonzero(marks[:, 5] > 0)
    at = np.repeat(np.arange(count), [c.size for c in column])
    of, z, sd = np.concatenate(column), np.concatenate(history.z), np.concatenate(history.sd)
    good = np.isin(of, alive)
    log = Log(
        step=np.array(history.step[1:]).reshape(-1, 3),
        step_sd=np.array(history.step_sd[1:]).reshape(-1, 4),
        at=at[good],
        of=np.searchsorted(alive, of[good]),
        z=z[good],
        sd=sd[good],
    )
    return Past(log, track, marks[alive, :2].copy(), alive, column)


class Anew(NamedTuple):
    """Particles drawn anew: pose (n, 3) and what it is drawn from, its mean (3,) and covariance (3, 3); landmarks (n, l, FIELDS)
    that belong to their tracks (None where they are fixed), their history, and the calibration (6,)."""

    pose: NDArray[np.float64]
    mean: NDArray[np.float64]
    cov: NDArray[np.float64]
    marks: NDArray[np.float64] | None
    history: History
    calibration: NDArray[np.float64]


def drawn_anew(
    history: History,
    best: int,
    marks: NDArray[np.float64],
    calibration: NDArray[np.float64],
    options: Options,
    n: int,
    rng: np.random.Generator,
) -> Anew:
    """n particles from the posterior of the whole track near particle `best`, whose landmarks are marks (l, FIELDS)."""
    past = of_particle(history, best, marks)
    track, places = _from_the_middle(history.middle, past)
    found = landmark_smoother.solve(past.log, track, places, calibration, options, draws=n, rng=rng)
    column = [c[None] for c in past.taken]
    middle = Middle(found.track, past.columns, found.marks)
    fresh = history._replace(column=column, settled=found.draws, middle=middle, pose=[], parents=[])
    given = None
    if not options.fixed:
        given = np.zeros((n, int(past.columns.max(initial=-1)) + 1, FIELDS))
        given[:, past.columns] = given_tracks(found.draws, found.marks, found.calibration, past.log)
        given[:, past.columns, 6] = marks[past.columns, 6]
    return Anew(
        pose=found.draws[:, -1].copy(),
        mean=found.track[-1].copy(),
        cov=found.end_cov,
        marks=given,
        history=fresh,
        calibration=found.calibration,
    )


def _from_the_middle(middle: Middle, past: Past) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The particle's track and landmarks as if its past were the middle that it was drawn around: less is left to be solved."""
    done = middle.track.shape[0]
    if done == 0:
        return past.track, past.places
    end, drawn = middle.track[-1:], past.track[done - 1 : done]
    moved = compose(end, between(drawn, past.track[done:]))
    flat = np.column_stack([past.places, np.zeros(past.columns.size)])
    places = compose(end, between(drawn, flat))[:, :2]
    places[np.isin(past.columns, middle.columns)] = middle.places[np.isin(middle.columns, past.columns)]
    return np.concatenate([middle.track, moved]), places
