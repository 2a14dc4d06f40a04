"""What a run hands over: track and landmarks of the end, or what is most probable afterwards; and doubtful landmarks."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core import landmark_store
from pfcli.core.geometry import wrap
from pfcli.dropped import Dropped
from pfcli.errors import LogError, printable
from pfcli.formats import landmark_csv
from pfcli.rng import Purpose, rng_for
from pfcli.systems.shared.contract import Result
from pfcli.systems.slam_landmarks import landmark_smoother, particle_history
from pfcli.systems.slam_landmarks.landmark_state import Assets, State
from pfcli.systems.slam_landmarks.params import Params
from pfcli.systems.slam_landmarks.particle_history import Past

_DRAWS = 200
"""So many draws tell the covariance of a smoothed track."""
_MANY, _MOVED = 10, 50.0
"""A landmark with so many detections moves if their median squared distance is this."""


def finish(state: State, assets: Assets, params: Params) -> Result:
    """Track and landmarks of the most probable particle; smoothed with `params.smooth`. Raises LogError where nothing told
    where the robot is among known landmarks."""
    if not state.history.z:
        raise LogError("no observation tells where the robot is among the known landmarks; two at once are needed")
    best = int(np.argmax(state.log_w))
    marks = landmark_store.landmarks(state.store, best)
    past, scales = particle_history.of_particle(state.history, best, marks), state.scales
    _doubt(past, state, assets.mapped)
    if params.smooth:
        options = landmark_smoother.Options(assets.mapped, params.calibrate)
        rng = rng_for(0, Purpose.PROPOSAL, 0)  # the end has no seed of its own, and needs none
        found = landmark_smoother.solve(past.log, past.track, past.places, scales, options, draws=_DRAWS, rng=rng)
        scales = found.scales
        if not assets.mapped:
            marks[past.columns] = landmark_smoother.given_tracks(found.track[None], found.marks, scales, past.log)[0]
        off = found.draws - found.track
        off[:, :, 2] = wrap(off[:, :, 2])
        state.track.replace(found.track, np.einsum("nta,ntb->tab", off, off) / _DRAWS)
    table = _table(past, marks[past.columns], state.names)
    summary: dict[str, Any] = {
        "updates": state.track.updates,
        "landmarks": int(past.columns.size),
        "resamplings": state.resamplings,
        "particles": params.particles,
        "smoothed": params.smooth,
    }
    if params.calibrate:
        summary |= {k: round(float(v), 4) for k, v in zip(landmark_smoother.SCALES, 1.0 + scales, strict=True)}
    text = {k: [round(float(v), 4) if k.endswith("_m") else v for v in values] for k, values in table.items()}
    return Result(
        state.track.track({}),
        None,
        state.frames.frames(),
        summary,
        tables={"landmarks": table},
        texts={"landmarks.csv": landmark_csv.text(text)},
        given_frame=assets.mapped,
        dropped=state.dropped,
    )


def _ids(past: Past, names: dict[str, int]) -> list[str]:
    """Of the landmarks of a particle: their names, or numbers where they have none."""
    by_column = {column: name for name, column in names.items()}
    return [by_column.get(k, str(k)) for k in past.columns.tolist()]


def _table(past: Past, marks: NDArray[np.float64], names: dict[str, int]) -> dict[str, Any]:
    """Columns of `landmarks.parquet`; marks (l, FIELDS): of the particle."""
    found: dict[str, Any] = {"id": _ids(past, names)}
    found |= dict(zip(("x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2"), marks[:, :5].T, strict=True))
    found["sightings"] = np.bincount(past.log.of, minlength=past.columns.size)
    return found


def _doubt(past: Past, state: State, mapped: bool) -> None:
    """Say which landmarks do not stay where they are; and, unless they are `mapped`, where none corrects the odometry."""
    dropped: Dropped = state.dropped
    squares = landmark_smoother.squared_errors(past.track, past.places, state.scales, past.log)
    for k, name in enumerate(_ids(past, state.names)):
        own = squares[past.log.of == k]
        if own.size >= _MANY and np.median(own) > _MOVED:
            far = f"it is seen {np.sqrt(np.median(own)):.0f} standard deviations off"
            dropped.add(
                "landmark that moves",
                f"landmark {printable(name)!r} does not stay in one place: {far}; it counts little",
            )
    if not mapped and np.bincount(past.log.of, minlength=1).max() < 2:
        dropped.add("landmarks seen once", "no landmark was seen twice: the track is that of the odometry alone")
