"""All that was driven and seen, by particle, and what follows from it as a whole."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.landmark_store import FIELDS
from pfcli.systems.slam_landmarks import smooth


class History(NamedTuple):
    """By observation: step and its spread, detections (z, sd), columns (n, m) that each particle took for them, and the pose
    (n, 3) of each afterwards."""

    step: list[NDArray[np.float64]]
    step_sd: list[NDArray[np.float64]]
    z: list[NDArray[np.float64]]
    sd: list[NDArray[np.float64]]
    column: list[NDArray[np.int32]]
    pose: list[NDArray[np.float64]]


class Past(NamedTuple):
    """What one particle drove and saw: the problem, its track (t, 3), its landmarks (l, 2) and their columns (l,)."""

    log: smooth.Log
    track: NDArray[np.float64]
    places: NDArray[np.float64]
    columns: NDArray[np.int64]


def record(
    history: History,
    step: NDArray[np.float64],
    step_sd: NDArray[np.float64],
    z: NDArray[np.float64],
    sd: NDArray[np.float64],
    column: NDArray[np.int32],
    pose: NDArray[np.float64],
) -> None:
    """Take note of an observation."""
    lists: tuple[list[Any], ...] = tuple(history)
    for rows, row in zip(lists, (step, step_sd, z, sd, column, pose), strict=True):
        rows.append(row)


def choose(history: History, ancestors: NDArray[np.int64]) -> None:
    """Give each particle the past of its parent."""
    for k in range(len(history.pose)):
        history.pose[k], history.column[k] = history.pose[k][ancestors], history.column[k][ancestors]


def of_particle(history: History, i: int, marks: NDArray[np.float64]) -> Past:
    """The past of particle i, whose landmarks are marks (l, FIELDS); those without sightings are none."""
    column = [c[i] for c in history.column]
    alive = np.flatnonzero(marks[:, 5] > 0)
    at = np.repeat(np.arange(len(history.pose)), [c.size for c in column])
    of, z, sd = np.concatenate(column), np.concatenate(history.z), np.concatenate(history.sd)
    good = np.isin(of, alive)
    log = smooth.Log(
        np.array(history.step[1:]).reshape(-1, 3),
        np.array(history.step_sd[1:]).reshape(-1, 3),
        at[good],
        np.searchsorted(alive, of[good]),
        z[good],
        sd[good],
    )
    return Past(log, np.array([p[i] for p in history.pose]), marks[alive, :2].copy(), alive)


def drawn_anew(
    history: History, best: int, marks: NDArray[np.float64], fixed: bool, n: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Poses (n, 3) of particles drawn from the posterior of the whole track near particle `best`, and the landmarks
    (n, l, FIELDS) that belong to their tracks; None where landmarks are fixed. The history is theirs from now on."""
    past = of_particle(history, best, marks)
    found = smooth.solve(past.log, past.track, past.places, fixed=fixed, draws=n, rng=rng)
    for k in range(len(history.pose)):
        history.pose[k] = np.ascontiguousarray(found.draws[:, k])
        history.column[k] = np.repeat(history.column[k][best][None], n, axis=0)
    pose = history.pose[-1].copy()
    if fixed:
        return pose, None
    given = np.zeros((n, int(past.columns.max()) + 1, FIELDS))
    given[:, past.columns] = smooth.given_tracks(found.draws, found.marks, past.log)
    return pose, given
