"""FastSLAM on landmarks with Gaussian distributed resampling (zhang2016gdr), and localisation among known landmarks.

One observation: particles move and are pulled by what they see (FastSLAM 2.0), are weighed, landmarks are updated, and offspring
are dispersed. Every so many observations the particles are drawn anew from all that was driven and seen: FastSLAM forgets what
it once did not know, for its particles share their past after some resamplings; the least-squares problem does not.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import landmark_store
from pfcli.core.geometry import between
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.events import Sighting
from pfcli.rng import Draw, Purpose
from pfcli.systems.shared.contract import Filter
from pfcli.systems.shared.resampling import ancestors_of, dispersed
from pfcli.systems.slam_landmarks import landmark_start, particle_history, pose_correction, sensor_calibration
from pfcli.systems.slam_landmarks.landmark_result import finish
from pfcli.systems.slam_landmarks.landmark_state import Assets, State, init, load, options_of
from pfcli.systems.slam_landmarks.motion_spread import motion_spread
from pfcli.systems.slam_landmarks.observation_kernels import IGNORED, UNKNOWN, observe
from pfcli.systems.slam_landmarks.params import Params
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


class _Observation(NamedTuple):
    """A sighting on its way through an update: view: its usable detections; moved (3,): the step since the last one in its base
    frame; driven_m, turned_rad: way and turn in between, all of them added up; used (n, m) or (1, m): the columns that each
    particle took for the detections."""

    sighting: Sighting
    view: View
    moved: NDArray[np.float64]
    driven_m: float
    turned_rad: float
    used: NDArray[np.int32]


def step(state: State, sighting: Sighting, assets: Assets, params: Params, draw: Draw) -> tuple[State, Info | None]:
    """Every observation with a usable detection updates the filter."""
    state.track.see(sighting)
    view, names = of_sighting(sighting, state.names, assets.mapped, params, state.dropped)
    state = state._replace(names=names)
    if view.z.shape[0] == 0:
        return state, None
    if not state.started:
        state = _start(state, sighting, view, assets, params, draw)
        if not state.started:
            return state, None
    state, seen = _moved(state, sighting, view)
    state, seen = _observe(state, seen, assets, params, draw)
    weights, log_evidence = normalize(state.log_w)
    state = state._replace(log_w=state.log_w - log_evidence)
    state, drawn_anew = _rejuvenate(state, seen, assets, params, draw)
    info = _report(state, seen, weights, log_evidence)._replace(rejuvenated=drawn_anew)
    n_eff_low = info.n_eff < params.resample_threshold * weights.size
    if drawn_anew or not n_eff_low:
        return state, info
    ancestors = ancestors_of(weights, params, draw, sighting.stamp_ns)
    state = _resample(state, ancestors, weights, params, draw, sighting.stamp_ns)
    return state, info._replace(resampled=True, unique_ancestors=int(np.unique(ancestors).size))


def _start(state: State, sighting: Sighting, view: View, assets: Assets, params: Params, draw: Draw) -> State:
    """Particles where the last sightings want them among the known landmarks, once these tell."""
    now = np.array([sighting.odometry])
    seen = landmark_start.Seen(now, view.points_m, view.spread_m, view.column)
    recent = (*state.recent, seen)[-landmark_start.RECENT :]
    pose = landmark_start.placed(recent, assets.places, params, draw(Purpose.INIT, sighting.stamp_ns))
    state = state._replace(odometry=now, travelled=sighting.travelled, recent=recent)
    return state if pose is None else state._replace(pose=pose, started=True, recent=())


def _moved(state: State, sighting: Sighting, view: View) -> tuple[State, _Observation]:
    """The step since the last observation."""
    now = np.array([sighting.odometry])
    moved = between(state.odometry, now)[0]
    way, turn = sighting.travelled[0] - state.travelled[0], sighting.travelled[1] - state.travelled[1]
    length = float(np.hypot(moved[0], moved[1]))
    # what was driven to and fro between two observations is noise as well
    driven = math.copysign(max(way, length), moved[0])
    state = state._replace(odometry=now, travelled=sighting.travelled, way_m=state.way_m + length)
    return state, _Observation(
        sighting=sighting,
        view=view,
        moved=moved,
        driven_m=driven,
        turned_rad=max(turn, abs(moved[2])),
        used=np.empty((0, view.column.size), np.int32),
    )


def _observe(
    state: State, seen: _Observation, assets: Assets, params: Params, draw: Draw
) -> tuple[State, _Observation]:
    """Move, associate, weigh, update (Montemerlo 2003); and write down what was driven and seen."""
    view, stamp_ns = seen.view, seen.sighting.stamp_ns
    most = max(len(state.names), int(state.columns.max(initial=0)) + view.column.size)
    store = landmark_store.reserve(state.store, most)
    pose, log_w = state.pose.copy(), state.log_w.copy()
    sd = motion_spread(seen.driven_m, seen.turned_rad, params)
    detected, moved = sensor_calibration.corrected(view.z, seen.moved, state.calibration)
    z = draw(Purpose.MOTION, stamp_ns).standard_normal(pose.shape)
    log_false = math.log(params.false_share / (2.0 * math.pi * params.landmark_range_m))
    version = 2.0 if params.proposal == "fastslam2" else 1.0
    gates = params.reject_gate, params.augment_gate
    options = (version, *gates, log_false, params.spurious_m, assets.mapped)
    columns = np.full(state.columns.size, len(state.names)) if view.column[0] != UNKNOWN else state.columns
    used = observe(pose, log_w, (moved, sd), (detected, *view[1:]), columns, store, z, options)
    particle_history.record(state.history, seen.moved, sd, view, used, pose)
    return state._replace(pose=pose, log_w=log_w, store=store, columns=columns), seen._replace(used=used)


def _rejuvenate(state: State, seen: _Observation, assets: Assets, params: Params, draw: Draw) -> tuple[State, bool]:
    """Every so many observations: particles drawn from the posterior of the whole track, each with the landmarks that belong to
    its track."""
    best, n = int(np.argmax(state.log_w)), params.particles
    state, back = _looked(state, seen.used[min(best, seen.used.shape[0] - 1)], params.rejuvenate_steps)
    due = state.since + 1 >= params.rejuvenate_steps or (back and not assets.mapped)
    if not (params.rejuvenate_steps and due):
        return state._replace(since=state.since + 1), False
    marks = landmark_store.landmarks(state.store, best)
    rng = draw(Purpose.PROPOSAL, seen.sighting.stamp_ns)
    options = options_of(assets, params)
    anew = particle_history.drawn_anew(state.history, best, marks, state.calibration, options, n, rng)
    # known landmarks tell more of the pose all the time
    anchor = pose_correction.unmoved(n) if assets.mapped else pose_correction.at(anew.mean, anew.cov, anew.pose)
    state = state._replace(
        pose=anew.pose,
        anchor=anchor,
        log_w=np.full(n, -np.log(n)),
        store=state.store if anew.marks is None else landmark_store.of_particles(anew.marks, n),
        columns=np.full(n, state.columns[best]),
        calibration=anew.calibration,
        history=anew.history,
        since=0,
    )
    return state, True


def _looked(state: State, used: NDArray[np.int32], steps: int) -> tuple[State, bool]:
    """Take note of the columns seen; whether one of them comes back after more than so many observations."""
    seen, now = used[used >= 0], len(state.history.z)
    fresh = np.full(max(0, int(seen.max(initial=-1)) + 1 - state.seen_at.size), -1)
    seen_at = np.concatenate([state.seen_at, fresh])
    back = bool(((seen_at[seen] >= 0) & (now - seen_at[seen] > steps)).any())
    seen_at[seen] = now
    return state._replace(seen_at=seen_at), back


def _report(state: State, seen: _Observation, weights: NDArray[np.float64], log_evidence: float) -> Info:
    """The estimate, into the track. weights (n,): of the particles before they were drawn anew."""
    found = pose_correction.estimated(state.anchor, state.pose, normalize(state.log_w)[0])
    state.track.update(found.pose, found.cov)
    state.frames.offer(seen.sighting.stamp_ns, found.pose, state.pose, seen.view.points_m)
    best = int(np.argmax(weights))
    return Info(
        t_ns=seen.sighting.stamp_ns,
        n_eff=float(effective_sample_size(weights)),
        resampled=False,
        unique_ancestors=weights.size,
        rejuvenated=False,
        log_evidence=log_evidence,
        detections=seen.view.column.size,
        ignored=int((seen.used[best] == IGNORED).sum()),
        landmarks=int((landmark_store.landmarks(state.store, best)[:, 5] > 0).sum()),
        sd_m=float(np.sqrt(found.cov[0, 0] + found.cov[1, 1])),
        sd_yaw_rad=float(np.sqrt(found.cov[2, 2])),
        way_m=state.way_m,
    )


def _resample(
    state: State, ancestors: NDArray[np.int64], weights: NDArray[np.float64], params: Params, draw: Draw, stamp_ns: int
) -> State:
    """Offspring with the landmarks and the past of their parents."""
    n = ancestors.size
    particle_history.choose(state.history, ancestors)
    return state._replace(
        pose=dispersed(state.pose, ancestors, weights, params, draw, stamp_ns),
        log_w=np.full(n, -np.log(n)),
        anchor=state.anchor._replace(shift=state.anchor.shift[ancestors]),
        store=landmark_store.choose(state.store, ancestors),
        columns=state.columns[ancestors],
        resamplings=state.resamplings + 1,
    )


FILTER = Filter(info=Info, load=load, init=init, step=step, finish=finish)
