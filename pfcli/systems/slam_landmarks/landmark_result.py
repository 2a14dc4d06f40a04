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
from pfcli.systems.slam_landmarks import (
    landmark_smoother,
    particle_history,
    sensor_calibration,
    whole_log_association,
)
from pfcli.systems.slam_landmarks.landmark_state import Assets, State, options_of
from pfcli.systems.slam_landmarks.landmarks_given_tracks import given_tracks
from pfcli.systems.slam_landmarks.params import Params
from pfcli.systems.slam_landmarks.particle_history import Past

_DRAWS = 200
"""So many draws tell the covariance of a smoothed track."""
_MANY, _MOVED = 10, 50.0
"""A landmark with so many detections moves if their median squared distance is this."""
_CLOSE, _APART_M = 20.0, 0.5
"""A rival that costs so little more, in squared standard deviations, and whose track is so far off, makes the map doubtful."""


def finish(state: State, assets: Assets, params: Params) -> Result:
    """Track and landmarks of the most probable particle; with `params.smooth` the smoothed ones, and where no landmark has an id
    the association is decided anew over the whole log. Raises LogError where nothing told where the robot is among known
    landmarks."""
    if not state.history.z:
        raise LogError("no observation tells where the robot is among the known landmarks; two at once are needed")
    best = int(np.argmax(state.log_w))
    marks = landmark_store.landmarks(state.store, best)
    past, calibration = particle_history.of_particle(state.history, best, marks), state.calibration
    marks = marks[past.columns]
    summary: dict[str, Any] = {"updates": state.track.updates}
    if params.smooth:
        if not (state.names or assets.mapped):
            past, rivals = _associated(past, state)
            summary |= rivals
        options = options_of(assets, params)
        rng = rng_for(0, Purpose.PROPOSAL, 0)  # the end has no seed of its own, and needs none
        found = landmark_smoother.solve(past.log, past.track, past.places, calibration, options, draws=_DRAWS, rng=rng)
        calibration = found.calibration
        if not assets.mapped:
            past = past._replace(track=found.track, places=found.marks)
            marks = given_tracks(found.track[None], found.marks, calibration, past.log)[0]
        off = found.draws - found.track
        off[:, :, 2] = wrap(off[:, :, 2])
        state.track.replace(found.track, np.einsum("nta,ntb->tab", off, off) / _DRAWS)
    _doubt(past, state, assets.mapped)
    table = _table(past, marks, state.names)
    summary |= {
        "landmarks": int(past.columns.size),
        "resamplings": state.resamplings,
        "particles": params.particles,
        "smoothed": params.smooth,
    }
    if calibration.any():
        summary |= sensor_calibration.summary(calibration)
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


def _associated(past: Past, state: State) -> tuple[Past, dict[str, Any]]:
    """The past with the most probable association of all detections, and for `run.json` what its rival costs."""
    every = past.log._replace(
        at=np.repeat(np.arange(len(past.taken)), [c.size for c in past.taken]),
        of=_numbered(np.concatenate(past.taken), past.columns),
        z=np.concatenate(state.history.z),
        sd=np.concatenate(state.history.sd),
    )
    hypotheses = whole_log_association.hypotheses(every, past.track)
    if not hypotheses:
        return past, {}
    best, *rivals = hypotheses
    good = best.of >= 0
    log = every._replace(at=every.at[good], of=best.of[good], z=every.z[good], sd=every.sd[good])
    found: dict[str, Any] = {"association_cost": round(best.cost, 1)}
    if rivals:
        apart = float(np.sqrt(np.square(best.track[:, :2] - rivals[0].track[:, :2]).sum(axis=1).mean()))
        found |= {"rival_cost": round(rivals[0].cost, 1), "rival_landmarks": int(rivals[0].marks.shape[0])}
        found |= {"rival_apart_m": round(apart, 3)}
        if rivals[0].cost - best.cost < _CLOSE and apart > _APART_M:
            state.dropped.add(
                "map doubtful",
                f"another association of the detections is as probable: its track is {apart:.2f} m off on the average, with"
                f" {rivals[0].marks.shape[0]} landmarks in place of {best.marks.shape[0]}; ids or better odometry would tell",
            )
    places = np.arange(best.marks.shape[0])
    return past._replace(log=log, track=best.track, places=best.marks, columns=places), found


def _numbered(columns: NDArray[np.int32], alive: NDArray[np.int64]) -> NDArray[np.int64]:
    """Columns (d,) as numbers among those alive, NOTHING where they are not."""
    at = np.minimum(np.searchsorted(alive, columns), alive.size - 1)
    return np.where(alive[at] == columns, at, whole_log_association.NOTHING)


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
    squares = landmark_smoother.squared_errors(past.track, past.places, state.calibration, past.log)
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
