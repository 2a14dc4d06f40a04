"""FastSLAM on landmarks with Gaussian distributed resampling (zhang2016gdr), and localisation among known landmarks.

One observation: particles move and are pulled by what they see (FastSLAM 2.0), are weighed, landmarks are updated, and offspring
are dispersed. Every so many observations the particles are drawn anew from all that was driven and seen: FastSLAM forgets what
it once did not know, for its particles share their past after some resamplings; the least-squares problem does not.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import landmark_store
from pfcli.core.geometry import between, wrap
from pfcli.core.landmark_store import FIELDS, Store
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.dropped import Dropped
from pfcli.errors import LogError, UsageError
from pfcli.events import Sighting
from pfcli.formats import landmark_csv
from pfcli.rng import Draw, Purpose, rng_for
from pfcli.systems.shared.contract import Filter, Job, Result
from pfcli.systems.shared.frame_keeper import FrameKeeper
from pfcli.systems.shared.resampling import ancestors_of, dispersed
from pfcli.systems.shared.track_keeper import TrackKeeper
from pfcli.systems.slam_landmarks import landmark_smoother, landmark_start
from pfcli.systems.slam_landmarks import landmark_table as landmarks
from pfcli.systems.slam_landmarks import particle_history as history
from pfcli.systems.slam_landmarks import pose_correction as anchor
from pfcli.systems.slam_landmarks.observation_kernels import IGNORED, UNKNOWN, observe
from pfcli.systems.slam_landmarks.params import Params
from pfcli.systems.slam_landmarks.particle_history import History
from pfcli.systems.slam_landmarks.usable_detections import View, of_sighting


class Info(NamedTuple):
    """One observation, as a row of `metrics.parquet`; landmarks: of the best particle; ignored: detections of nothing."""

    t_ns: int
    n_eff: float
    resampled: bool
    unique_ancestors: int
    rejuvenated: bool
    log_evidence: float
    detections: int
    ignored: int
    landmarks: int
    sd_m: float
    sd_yaw_rad: float
    way_m: float


class Assets(NamedTuple):
    """places: known landmarks by id, empty in SLAM."""

    places: dict[str, tuple[float, float]]


class State(NamedTuple):
    """pose (n, 3), log weight (n,), landmarks and how many columns of them (n,) each particle has; names: id -> column;
    seen_at (columns,): the observation that saw it last, -1 for none; odometry (1, 3) and way and turn at the last observation;
    since: observations since the particles were drawn anew; recent: what was seen before the start; dropped: what was left out;
    scales of `smooth.corrected`; what the end needs."""

    pose: NDArray[np.float64]
    log_w: NDArray[np.float64]
    anchor: anchor.Anchor
    store: Store
    columns: NDArray[np.int64]
    names: dict[str, int]
    seen_at: NDArray[np.int64]
    odometry: NDArray[np.float64]
    travelled: tuple[float, float]
    way_m: float
    since: int
    started: bool
    recent: tuple[landmark_start.Seen, ...]
    dropped: Dropped
    scales: NDArray[np.float64]
    history: History
    track: TrackKeeper
    frames: FrameKeeper
    resamplings: int


_DRAWS = 200
"""So many draws tell the covariance of a smoothed track."""


def load(params: Params, job: Job) -> Assets:
    """Read the known landmarks, if any. Raises LogError for a file that is none, UsageError for gates in the wrong order."""
    if params.reject_gate > params.augment_gate:
        raise UsageError(f"--reject-gate {params.reject_gate:g} must not exceed --augment-gate {params.augment_gate:g}")
    return Assets(landmark_csv.read(Path(params.landmark_map)) if params.landmark_map else {})


def init(params: Params, assets: Assets, first: Sighting, draw: Draw) -> State:
    """All particles where odometry is, with an empty map; or nowhere yet among known landmarks."""
    n = params.particles
    store, columns = landmark_store.empty(n), np.zeros(n, np.int64)
    names: dict[str, int] = {}
    if assets.places:
        store, names = _known(assets, n)
        columns[:] = len(names)
    return State(
        np.tile(np.array(first.odometry, float), (n, 1)),
        np.full(n, -np.log(n)),
        anchor.unmoved(n),
        store,
        columns,
        names,
        np.empty(0, np.int64),
        np.array([first.odometry]),
        first.travelled,
        0.0,
        0,
        not assets.places,
        (),
        Dropped(),
        landmark_smoother.no_scales(),
        history.empty(),
        TrackKeeper(),
        FrameKeeper(),
        0,
    )


def _known(assets: Assets, n: int) -> tuple[Store, dict[str, int]]:
    """A store in which all particles share the known landmarks."""
    names = {name: k for k, name in enumerate(assets.places)}
    marks = np.zeros((1, len(names), FIELDS))
    marks[0, :, :2] = list(assets.places.values())
    marks[0, :, 2:] = (1e-8, 0.0, 1e-8, 1.0, 1.0)
    return landmark_store.choose(landmark_store.of_particles(marks, n), np.zeros(n, np.int64)), names


def step(state: State, sighting: Sighting, assets: Assets, params: Params, draw: Draw) -> tuple[State, Info | None]:
    """Every observation with a usable detection updates the filter."""
    state.track.see(sighting)
    view, names = of_sighting(sighting, state.names, bool(assets.places), params, state.dropped)
    state = state._replace(names=names)
    if view.z.shape[0] == 0:
        return state, None
    now = np.array([sighting.odometry])
    if not state.started:
        recent = (*state.recent, landmark_start.Seen(now, view.points_m, view.spread_m, view.column))[
            -landmark_start.RECENT :
        ]
        pose = landmark_start.placed(recent, assets.places, params, draw(Purpose.INIT, sighting.stamp_ns))
        if pose is None:
            return state._replace(odometry=now, travelled=sighting.travelled, recent=recent), None
        state = state._replace(pose=pose, started=True, odometry=now, travelled=sighting.travelled, recent=())
    moved = between(state.odometry, now)[0]
    gone = sighting.travelled[0] - state.travelled[0], sighting.travelled[1] - state.travelled[1]
    way = state.way_m + float(np.hypot(moved[0], moved[1]))
    state = state._replace(odometry=now, travelled=sighting.travelled, way_m=way)
    state, used = _observe(state, view, moved, gone, sighting.stamp_ns, assets, params, draw)
    return _conclude(state, sighting, view, used, assets, params, draw)


def _observe(
    state: State,
    view: View,
    moved: NDArray[np.float64],
    travelled: tuple[float, float],
    stamp_ns: int,
    assets: Assets,
    params: Params,
    draw: Draw,
) -> tuple[State, NDArray[np.int32]]:
    """Move, associate, weigh, update; and write down what was driven and seen."""
    m = view.z.shape[0]
    most = max(len(state.names), int(state.columns.max(initial=0)) + m)
    store = landmark_store.reserve(state.store, most)
    pose, log_w = state.pose.copy(), state.log_w.copy()
    way, turn = travelled
    # what was driven to and fro between two observations is noise as well
    driven = math.copysign(max(way, float(np.hypot(moved[0], moved[1]))), moved[0])
    sd = _spread(driven, max(turn, abs(moved[2])), params)
    seen, step = landmark_smoother.corrected(view.z, moved, state.scales)
    z = draw(Purpose.MOTION, stamp_ns).standard_normal(pose.shape)
    log_false = math.log(params.false_share / (2.0 * math.pi * params.landmark_range_m))
    version = 2.0 if params.proposal == "fastslam2" else 1.0
    gates = params.reject_gate, params.augment_gate
    options = (version, *gates, log_false, params.spurious_m, bool(assets.places))
    columns = np.full(state.columns.size, len(state.names)) if view.column[0] != UNKNOWN else state.columns
    used = observe(pose, log_w, (step, sd), (seen, *view[1:]), columns, store, z, options)
    history.record(state.history, moved, sd, view.z, np.sqrt(view.noise), used, pose)
    return state._replace(pose=pose, log_w=log_w, store=store, columns=columns), used


def _spread(driven: float, turn: float, params: Params) -> NDArray[np.float64]:
    """(4,) along, across (m), of turning (rad), and how far behind (m) its errors turn about. driven: negative backwards.

    Variances grow with way and turn, so that a step is as uncertain as its parts together, however rarely something is seen.
    Turning errors add up along the way: on the average they are about its middle, and across it they leave what parts turned
    at different times.
    """
    way = abs(driven)
    along = math.sqrt(params.motion_xy_m**2 + params.motion_xy_per_root_m**2 * way)
    turning = params.motion_yaw_per_root_m**2 * way + params.motion_yaw_per_root_rad**2 * turn
    yaw = math.sqrt(params.motion_yaw_rad**2 + turning)
    across = math.hypot(params.motion_across_share * along, way * yaw / math.sqrt(12.0))
    return np.array([along, across, yaw, params.motion_pivot_m + driven / 2.0])


def _conclude(
    state: State,
    sighting: Sighting,
    view: View,
    used: NDArray[np.int32],
    assets: Assets,
    params: Params,
    draw: Draw,
) -> tuple[State, Info]:
    """Draw the particles anew from the whole past and report, or report and resample."""
    weights, log_evidence = normalize(state.log_w)
    state = state._replace(log_w=state.log_w - log_evidence)
    best = int(np.argmax(weights))
    marks = landmark_store.landmarks(state.store, best)
    n_eff = float(effective_sample_size(weights))
    since = state.since + 1
    state, back = _looked(state, used[min(best, used.shape[0] - 1)], params.rejuvenate_steps)
    due = since >= params.rejuvenate_steps or (back and not assets.places)
    fresh = bool(params.rejuvenate_steps and due)
    ancestors = np.arange(state.pose.shape[0])
    resample = not fresh and n_eff < params.resample_threshold * state.pose.shape[0]
    if fresh:
        state = _rejuvenate(state, best, assets, params, draw, sighting.stamp_ns)
    found = anchor.estimated(state.anchor, state.pose, normalize(state.log_w)[0])
    state.track.update(found.pose, found.cov)
    state.frames.offer(sighting.stamp_ns, found.pose, state.pose, view.points_m)
    if resample:
        ancestors = ancestors_of(weights, params, draw, sighting.stamp_ns)
        state = _chosen(state, ancestors, weights, params, draw, sighting.stamp_ns)
    info = Info(
        t_ns=sighting.stamp_ns,
        n_eff=n_eff,
        resampled=bool(resample),
        unique_ancestors=int(np.unique(ancestors).size),
        rejuvenated=fresh,
        log_evidence=log_evidence,
        detections=view.z.shape[0],
        ignored=int((used[best] == IGNORED).sum()),
        landmarks=int((marks[:, 5] > 0).sum()),
        sd_m=float(np.sqrt(found.cov[0, 0] + found.cov[1, 1])),
        sd_yaw_rad=float(np.sqrt(found.cov[2, 2])),
        way_m=state.way_m,
    )
    return state._replace(since=0 if fresh else since), info


def _looked(state: State, used: NDArray[np.int32], steps: int) -> tuple[State, bool]:
    """Take note of the columns seen; whether one of them comes back after more than so many observations."""
    seen, now = used[used >= 0], len(state.history.z)
    fresh = np.full(max(0, int(seen.max(initial=-1)) + 1 - state.seen_at.size), -1)
    seen_at = np.concatenate([state.seen_at, fresh])
    back = bool(((seen_at[seen] >= 0) & (now - seen_at[seen] > steps)).any())
    seen_at[seen] = now
    return state._replace(seen_at=seen_at), back


def _chosen(
    state: State, ancestors: NDArray[np.int64], weights: NDArray[np.float64], params: Params, draw: Draw, stamp_ns: int
) -> State:
    """Offspring with the landmarks and the past of their parents."""
    n = ancestors.size
    history.choose(state.history, ancestors)
    return state._replace(
        pose=dispersed(state.pose, ancestors, weights, params, draw, stamp_ns),
        log_w=np.full(n, -np.log(n)),
        anchor=state.anchor._replace(shift=state.anchor.shift[ancestors]),
        store=landmark_store.choose(state.store, ancestors),
        columns=state.columns[ancestors],
        resamplings=state.resamplings + 1,
    )


def _rejuvenate(state: State, best: int, assets: Assets, params: Params, draw: Draw, stamp_ns: int) -> State:
    """Particles drawn from the posterior of the whole track, each with the landmarks that belong to its track."""
    n, rng = params.particles, draw(Purpose.PROPOSAL, stamp_ns)
    marks = landmark_store.landmarks(state.store, best)
    anew = history.drawn_anew(state.history, best, marks, state.scales, _options(assets, params), n, rng)
    # known landmarks tell more of the pose all the time
    anchored = anchor.unmoved(n) if assets.places else anchor.at(anew.mean, anew.cov, anew.pose)
    return state._replace(
        pose=anew.pose,
        anchor=anchored,
        log_w=np.full(n, -np.log(n)),
        store=state.store if anew.marks is None else landmark_store.of_particles(anew.marks, n),
        columns=np.full(n, state.columns[best]),
        scales=anew.scales,
        history=anew.history,
    )


def _options(assets: Assets, params: Params) -> landmark_smoother.Options:
    return landmark_smoother.Options(bool(assets.places), params.calibrate)


def finish(state: State, assets: Assets, params: Params) -> Result:
    """Track and landmarks of the end, or what is most probable afterwards."""
    if not state.history.z:
        raise LogError("no observation tells where the robot is among the known landmarks; two at once are needed")
    best = int(np.argmax(state.log_w))
    marks = landmark_store.landmarks(state.store, best)
    past = history.of_particle(state.history, best, marks)
    options, scales = _options(assets, params), state.scales
    landmarks.doubt(past, scales, state.names, options.fixed, state.dropped)
    if params.smooth:
        rng = rng_for(0, Purpose.PROPOSAL, 0)  # the end has no seed of its own, and needs none
        found = landmark_smoother.solve(past.log, past.track, past.places, scales, options, draws=_DRAWS, rng=rng)
        scales = found.scales
        if not options.fixed:
            marks[past.columns] = landmark_smoother.given_tracks(found.track[None], found.marks, scales, past.log)[0]
        off = found.draws - found.track
        off[:, :, 2] = wrap(off[:, :, 2])
        state.track.replace(found.track, np.einsum("nta,ntb->tab", off, off) / _DRAWS)
    table = landmarks.table(past, marks[past.columns], state.names)
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
    texts = {"landmarks.csv": landmark_csv.text(text)}
    return Result(
        state.track.track({}),
        None,
        state.frames.frames(),
        summary,
        tables={"landmarks": table},
        texts=texts,
        given_frame=options.fixed,
        dropped=state.dropped,
    )


FILTER = Filter(info=Info, load=load, init=init, step=step, finish=finish)
