"""What the filter keeps between two observations, and what it starts from."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import landmark_store
from pfcli.core.landmark_store import FIELDS, Store
from pfcli.dropped import Dropped
from pfcli.errors import UsageError
from pfcli.events import Sighting
from pfcli.formats import landmark_csv
from pfcli.rng import Draw
from pfcli.systems.shared.contract import Job
from pfcli.systems.shared.frame_keeper import FrameKeeper
from pfcli.systems.shared.track_keeper import TrackKeeper
from pfcli.systems.slam_landmarks import particle_history, pose_correction, sensor_calibration
from pfcli.systems.slam_landmarks.landmark_problem import ALL, Options
from pfcli.systems.slam_landmarks.landmark_start import Seen
from pfcli.systems.slam_landmarks.params import Params
from pfcli.systems.slam_landmarks.particle_history import History
from pfcli.systems.slam_landmarks.pose_correction import Anchor


class Assets(NamedTuple):
    """places: known landmarks by id, empty in SLAM."""

    places: dict[str, tuple[float, float]]

    @property
    def mapped(self) -> bool:
        """Whether the landmarks are known."""
        return bool(self.places)


class State(NamedTuple):
    """The particles, and what an update needs of the past.

    pose (n, 3) and log_w (n,): the particles; anchor: what takes them back to the last least squares; store: their landmarks,
    columns (n,): how many columns of it each has; names: id -> column; seen_at (columns,): the observation that saw it last, -1
    for none; odometry (1, 3) and travelled (way, turn): at the last observation; since: observations since the particles were
    drawn anew; recent: what was seen before the start; dropped: what was left out; calibration: (6,);
    history, track and frames: what the end needs.
    """

    pose: NDArray[np.float64]
    log_w: NDArray[np.float64]
    anchor: Anchor
    store: Store
    columns: NDArray[np.int64]
    names: dict[str, int]
    seen_at: NDArray[np.int64]
    odometry: NDArray[np.float64]
    travelled: tuple[float, float]
    way_m: float
    since: int
    started: bool
    recent: tuple[Seen, ...]
    dropped: Dropped
    calibration: NDArray[np.float64]
    history: History
    track: TrackKeeper
    frames: FrameKeeper
    resamplings: int


def load(params: Params, job: Job) -> Assets:
    """Read the known landmarks, if any. Raises LogError for a file that is none, UsageError for gates in the wrong order."""
    if params.reject_gate > params.augment_gate:
        raise UsageError(f"--reject-gate {params.reject_gate:g} must not exceed --augment-gate {params.augment_gate:g}")
    return Assets(landmark_csv.read(Path(params.landmark_map)) if params.landmark_map else {})


def options_of(assets: Assets, params: Params) -> Options:
    """What the least squares do not know: among known landmarks the calibration; in SLAM much of it looks like another map."""
    return Options(fixed=True, learnt=ALL) if assets.mapped and params.calibrate else Options(fixed=assets.mapped)


def init(params: Params, assets: Assets, first: Sighting, draw: Draw) -> State:
    """All particles where odometry is, with an empty map; or nowhere yet among known landmarks."""
    n = params.particles
    store, names = _known(assets, n) if assets.mapped else (landmark_store.empty(n), {})
    return State(
        pose=np.tile(np.array(first.odometry, float), (n, 1)),
        log_w=np.full(n, -np.log(n)),
        anchor=pose_correction.unmoved(n),
        store=store,
        columns=np.full(n, len(names)),
        names=names,
        seen_at=np.empty(0, np.int64),
        odometry=np.array([first.odometry]),
        travelled=first.travelled,
        way_m=0.0,
        since=0,
        started=not assets.mapped,
        recent=(),
        dropped=Dropped(),
        calibration=sensor_calibration.none(),
        history=particle_history.empty(),
        track=TrackKeeper(),
        frames=FrameKeeper(),
        resamplings=0,
    )


def _known(assets: Assets, n: int) -> tuple[Store, dict[str, int]]:
    """A store in which all n particles share the known landmarks, and the column of each id."""
    names = {name: k for k, name in enumerate(assets.places)}
    landmarks = np.zeros((1, len(names), FIELDS))
    landmarks[0, :, :2] = list(assets.places.values())
    landmarks[0, :, 2:] = (1e-8, 0.0, 1e-8, 1.0, 1.0)
    return landmark_store.choose(landmark_store.of_particles(landmarks, n), np.zeros(n, np.int64)), names
