"""What least squares would give on Bailey's worlds: on all that was seen so far, and on everything, ours and scipy's.

python benchmarks/landmarks_bound.py [seeds]

PFCLI_DATA names the folder with bailey/.
"""

import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any
from unittest import mock

import landmarks
import numpy as np
from scipy import sparse
from scipy.optimize import least_squares

from pfcli.core import landmark_store
from pfcli.core.geometry import compose
from pfcli.registry import filter_of
from pfcli.runs import loop
from pfcli.simulation import landmark_world as simulated
from pfcli.systems.slam_landmarks import landmark_smoother, particle_history
from pfcli.systems.slam_landmarks.landmark_problem import Log
from pfcli.systems.slam_landmarks.params import Params


def _least_squares(log: Log, track: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """The track of plain least squares by scipy's solver: nothing of it is pfcli's but the list of measurements."""
    n, known = log.step.shape[0], track[0]

    def residuals(p: np.ndarray) -> np.ndarray:
        poses, places = np.vstack([known, p[: 3 * n].reshape(n, 3)]), p[3 * n :].reshape(-1, 2)
        a, b = poses[:-1], poses[1:]
        c, s, d = np.cos(a[:, 2]), np.sin(a[:, 2]), b[:, :2] - a[:, :2]
        turn = np.remainder(b[:, 2] - a[:, 2] - log.step[:, 2] + np.pi, 2 * np.pi) - np.pi
        e = np.stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0]], axis=1) - log.step[:, :2]
        e[:, 1] -= log.step_sd[:, 3] * turn
        off = places[log.of] - poses[log.at, :2]
        bearing = np.arctan2(off[:, 1], off[:, 0]) - poses[log.at, 2] - log.z[:, 1]
        seen = np.stack([np.hypot(*off.T) - log.z[:, 0], np.remainder(bearing + np.pi, 2 * np.pi) - np.pi], axis=1)
        return np.concatenate([(np.column_stack([e, turn]) / log.step_sd[:, :3]).ravel(), (seen / log.sd).ravel()])

    k, d = np.arange(n), np.arange(log.at.size)
    rows = [
        np.repeat(3 * np.repeat(k, 3) + np.tile(np.arange(3), n), 6),
        np.repeat(3 * n + np.repeat(2 * d, 2) + np.tile([0, 1], d.size), 5),
    ]
    steps = np.repeat(3 * (k[:, None] - 1) + np.arange(6), 3, axis=0)
    seen = np.column_stack([3 * (log.at[:, None] - 1) + np.arange(3), 3 * n + 2 * log.of[:, None] + np.arange(2)])
    row, column = np.concatenate(rows), np.concatenate([steps.ravel(), np.repeat(seen, 2, axis=0).ravel()])
    pattern = sparse.coo_matrix(
        (np.ones(row.size)[column >= 0], (row[column >= 0], column[column >= 0])),
        shape=(3 * n + 2 * d.size, 3 * n + marks.size),
    )
    start = np.concatenate([track[1:].ravel(), marks.ravel()])
    found = least_squares(residuals, start, jac_sparsity=pattern.tocsr(), x_scale="jac", max_nfev=30, tr_solver="lsmr")
    return np.vstack([known, found.x[: 3 * n].reshape(n, 3)])


def bounds(name: str, seed: int) -> tuple[float, float, float]:
    """RMSE of: least squares on all that was seen up to each 50th observation; on everything; on everything by scipy."""
    kept: list[Any] = []
    inner = filter_of(landmarks.SLAM)

    def finish(state: Any, assets: Any, params: Any) -> Any:
        kept.append(state)
        return inner.finish(state, assets, params)

    world = landmarks.bailey(name)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        simulated.write(world, seed, log)
        params = Params(particles=20, rejuvenate_steps=0, **simulated.NOISE)
        with mock.patch.object(loop, "filter_of", return_value=inner._replace(finish=finish)):
            loop.execute(loop.Job(landmarks.SLAM, params, [log], seed, threads=1))
    truth = np.array([now.truth for now in simulated.play(world, seed) if now.seen is not None and now.seen.size])
    best = int(np.argmax(kept[0].log_w))
    past = particle_history.of_particle(kept[0].history, best, landmark_store.landmarks(kept[0].store, best))
    whole = landmark_smoother.solve(past.log, past.track, past.places)
    reference = _least_squares(past.log, whole.track, whole.marks)
    track, places, errors = whole.track[:1], whole.marks.copy(), []
    for t in range(50, truth.shape[0], 50):
        track, places = _upto(past.log, t, track, places)
        errors.append(np.hypot(*(track[t] - truth[t])[:2]))
    off = [landmarks.rmse(np.hypot(*(t - truth)[:, :2].T)) for t in (whole.track, reference)]
    return landmarks.rmse(np.array(errors)), off[0], off[1]


def _upto(log: Log, t: int, track: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares on what was seen up to observation t, from the solution of an earlier one."""
    rows = list(track)
    for step in log.step[len(rows) - 1 : t]:
        rows.append(compose(rows[-1][None], step[None])[0])
    seen = log.at <= t
    used, of = np.unique(log.of[seen], return_inverse=True)
    part = Log(step=log.step[:t], step_sd=log.step_sd[:t], at=log.at[seen], of=of, z=log.z[seen], sd=log.sd[seen])
    found = landmark_smoother.solve(part, np.array(rows), places[used])
    places = places.copy()
    places[used] = found.marks
    return found.track, places


def bound(seeds: int, names: Sequence[str]) -> None:
    with ProcessPoolExecutor(2) as pool:
        for name in names:
            found = np.array(list(pool.map(bounds, [name] * seeds, range(seeds))))
            for k, label in enumerate(
                ("least squares so far", "least squares of everything", "scipy's, of everything")
            ):
                print(f"{name}, {label}: median RMSE {landmarks.interval(found[:, k])} m, {seeds} seeds", flush=True)


if __name__ == "__main__":
    bound(int(sys.argv[1]) if len(sys.argv) > 1 else 50, sys.argv[2:] or ("densemap", "webmap"))
