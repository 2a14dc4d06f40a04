"""Reliable Monte Carlo localisation: pose, beam classes and success together. Akai 2023 (akai2023reliable).

One update, in the paper's order (section 5): particles and reliabilities are predicted, global samples are drawn, both
sets are weighed by the class-conditional measurement model and the decision model, the pose, the classes of the beams and
the reliability are estimated, and the particles are resampled from the union.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate
from pfcli.core.geometry import compose
from pfcli.core.motion.odometry import predict
from pfcli.core.resample import systematic
from pfcli.core.sensor import class_conditional
from pfcli.core.sensor.class_conditional import Fit, Model, Scan
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.events import Sweep
from pfcli.registry import System
from pfcli.rng import Draw, Purpose
from pfcli.systems.frames import FrameKeeper
from pfcli.systems.localize_reliable import decision, key_scans, proposal, sampler, start, track_record
from pfcli.systems.localize_reliable.assets import Assets, gain_of, load, model_of, reach_m, scan_of
from pfcli.systems.localize_reliable.decision import Classifier
from pfcli.systems.localize_reliable.params import Params
from pfcli.systems.localize_reliable.protection import protection_level_m
from pfcli.systems.localize_reliable.records import Records
from pfcli.systems.localize_reliable.residuals import misaligned_share
from pfcli.systems.localize_reliable.track_record import TrackRecord
from pfcli.systems.pace import step_noise, step_since
from pfcli.systems.result import Result
from pfcli.systems.track import TrackKeeper

_MODE_M, _MODE_RAD = 0.75, 0.5
_CARRIED = 0.3
"""Share of a scan that is new, beyond what a turn brings, when the robot was carried or its wheels have slipped."""
_REMEMBERED = 6
"""Key scans that tell what is new, at least."""


class Info(NamedTuple):
    """One update, as a row of `metrics.parquet`; precision: P(a place is right that is trusted and was kept so long), a
    factor of p_success; mae_m, hits, through, unknown_share, misaligned: of the scan at the
    estimate; gl_*: global samples drawn, their matches of key points, and their share of the mass; new_share: of the beams,
    that no key scan showed before."""

    t_ns: int
    p_success: float
    precision: float
    protection_m: float
    mae_m: float
    hits: float
    through: float
    unknown_share: float
    misaligned: float
    mode_share: float
    sd_m: float
    n_eff: float
    gl_drawn: int
    gl_matches: int
    gl_mass: float
    new_share: float
    log_evidence: float
    resampled: bool
    way_m: float
    beams: int


class State(NamedTuple):
    """pose (n, 3), log weight (n,) and p(success) (n,) of each particle; believed (n,): of the hypothesis that was
    reported last; predicted: where the last estimate (3,) is now by odometry; odometry (1, 3) of the last update; places
    that were trusted; key scans; stamp of the last global sampling; what was learnt of the map; what the end of the run
    needs."""

    pose: NDArray[np.float64]
    log_w: NDArray[np.float64]
    reliability: NDArray[np.float64]
    believed: NDArray[np.bool_]
    predicted: NDArray[np.float64] | None
    odometry: NDArray[np.float64]
    way_m: float
    record: TrackRecord
    history: list[key_scans.KeyScan]
    sampled_ns: int
    classifier: Classifier | None
    track: TrackKeeper
    frames: FrameKeeper
    records: Records


def init(params: Params, assets: Assets, first: Sweep, draw: Draw) -> State:
    """Nothing is known before the first usable scan."""
    odometry = np.array([first.odometry], np.float64)
    records = Records(assets.grid, params.beams_table)
    nothing = np.empty(0)
    return State(
        np.empty((0, 3)),
        nothing,
        nothing,
        np.empty(0, np.bool_),
        None,
        odometry,
        0.0,
        track_record.NOTHING,
        [],
        -(1 << 62),
        None,
        TrackKeeper(),
        FrameKeeper(),
        records,
    )


def step(state: State, sweep: Sweep, assets: Assets, params: Params, draw: Draw) -> tuple[State, Info | None]:
    """Every scan is recorded; one that has moved far enough updates the filter."""
    state.track.see(sweep)
    first = state.pose.shape[0] == 0
    now, moved, way, far = step_since(state.odometry, sweep.odometry, params)
    if not (first or far):
        return state, None
    scan, points = scan_of(sweep, params)
    if scan.range_m.size == 0:
        return state, None
    model = model_of(params, reach_m(sweep, params))
    if first:
        state = _begin(state, scan, sweep, model, assets, params, draw)
    else:
        state = _predict(state, moved, sweep.stamp_ns, params, draw)
    state = state._replace(odometry=now, way_m=state.way_m + way)
    new = key_scans.new_share(scan, now, state.history)
    if new > _CARRIED + key_scans.turned_share(sweep.scan, now, state.history):
        state.history.clear()  # earlier scans do not lie where odometry says
    worth = min(1.0, new / gain_of(params, scan)) if params.new_only else 1.0
    key = key_scans.KeyScan(now, points, scan, worth)
    key_scans.remember(state.history, key, max(_REMEMBERED, params.gl_steps + 1))
    state, drawn, matches = _weigh(state, scan, key, sweep.stamp_ns, model, assets, params, draw)
    return _conclude(state, sweep, scan, model, assets, params, draw, (drawn, matches, new))


def _begin(state: State, scan: Scan, sweep: Sweep, model: Model, assets: Assets, params: Params, draw: Draw) -> State:
    """The first particles; nothing speaks for or against them yet."""
    pose = start.scatter(scan, model, assets, params, draw(Purpose.INIT, sweep.stamp_ns))
    n = pose.shape[0]
    return state._replace(
        pose=pose,
        log_w=np.full(n, -np.log(n)),
        reliability=np.full(n, 0.5),
        believed=np.ones(n, np.bool_),
        classifier=start.classifier_for(sweep, model, assets, params) if params.estimate_reliability else None,
    )


def _predict(state: State, moved: NDArray[np.float64], stamp_ns: int, params: Params, draw: Draw) -> State:
    """Motion of the particles, decay of their reliabilities; failure never becomes success by moving."""
    z = draw(Purpose.MOTION, stamp_ns).standard_normal(state.pose.shape)
    pose = predict(state.pose, moved, step_noise(moved, params), z)
    d2, a2 = moved[0] ** 2 + moved[1] ** 2, moved[2] ** 2
    left = max(0.0, 1.0 - params.decay_per_m2 * d2 - params.decay_per_rad2 * a2)
    predicted = None if state.predicted is None else compose(state.predicted[None], moved[None])[0]
    return state._replace(pose=pose, reliability=state.reliability * left, predicted=predicted)


def _judge(
    fit: Fit, reliability: NDArray[np.float64], gain: float, found: Classifier | None, params: Params
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n,) log p(z, d | x) up to a constant, and p(success) after the scan. Akai 2023, eqs (2) and (4).

    d is a function of z, so that weighing by both counts the residuals twice: the decision weighs only if asked to.
    """
    log = gain * fit.log_likelihood
    if found is None:
        return log, reliability
    ratio = np.exp(params.decision_gain * decision.log_ratio(fit, found))
    both = reliability * ratio + (1.0 - reliability)
    top = params.reliability_top
    if params.decision_weighs:
        log = log + np.log(both)
    return log, np.clip(reliability * ratio / both, 1.0 - top, top)


def _rivalry(state: State, log: NDArray[np.float64], worth: float) -> NDArray[np.float64]:
    """(n,) log weights after a scan: within what is believed, and among its rivals, the whole of it counts; between the
    two the share that it is worth beside the key scans."""
    rival, after = ~state.believed, state.log_w + log
    if not rival.any() or rival.all():
        return after
    for_rivals, against = (normalize(after[k])[1] - normalize(state.log_w[k])[1] for k in (rival, state.believed))
    return after - np.where(rival, (1.0 - worth) * (for_rivals - against), 0.0)


def _weigh(
    state: State,
    scan: Scan,
    key: key_scans.KeyScan,
    stamp_ns: int,
    model: Model,
    assets: Assets,
    params: Params,
    draw: Draw,
) -> tuple[State, int, int]:
    """The scan weighs the particles, those around a scan match, and the global samples where these are due."""
    gain, prior = gain_of(params, scan), np.exp(state.log_w)
    due = params.use_gl and stamp_ns - state.sampled_ns >= params.gl_period * 1e9
    due = due and not (params.gl_gate and float(prior @ state.reliability) >= 0.5)
    tracked, drawn, matches = state, 0, 0
    if params.match_samples:
        state = _matched(state, scan, gain, model, assets, params, draw(Purpose.PROPOSAL, stamp_ns))
    if due:
        rng = draw(Purpose.INJECT, stamp_ns)
        state, matches = _sampled(state, tracked, key, gain, model, assets, params, rng)
        drawn, state = params.gl_samples, state._replace(sampled_ns=stamp_ns)
    fit = class_conditional.fit(state.pose, scan, assets.field, model)
    log, reliability = _judge(fit, state.reliability, gain, state.classifier, params)
    return state._replace(log_w=_rivalry(state, log, key.worth), reliability=reliability), drawn, matches


def _sampled(
    state: State,
    tracked: State,
    key: key_scans.KeyScan,
    gain: float,
    model: Model,
    assets: Assets,
    params: Params,
    rng: np.random.Generator,
) -> tuple[State, int]:
    """Global samples join; `tracked`: what the tracker predicted. Returns how many key points matched as well."""
    history, count = state.history, params.gl_samples
    pose, matches = sampler.candidates(history, key, params.gl_steps, assets.features, assets.free_xy, rng)
    pose = sampler.gather(pose, sampler.STAGES, count, key.scan, assets.field, model, gain, rng)
    # key scans end where the robot may have been carried: since then a robot here has seen what the believed one has
    own = tracked.pose[int(np.argmax(np.where(tracked.believed, tracked.log_w, -np.inf)))]
    past = key_scans.past_evidence(np.vstack([pose, own]), history, key, assets.field, model, gain)
    prior, area = np.exp(tracked.log_w), assets.free_xy.shape[0] * assets.grid.resolution_m**2
    importance = sampler.log_importance(pose, tracked.pose, prior, params.gl_uniform, area, past[:-1] - past[-1])
    here = estimate.members(pose, own, _MODE_M, _MODE_RAD)
    state = state._replace(log_w=state.log_w + sampler.halved(state.pose, pose))
    return _joined(state, pose, importance - np.log(count), np.full(count, 0.5), here), matches


def _matched(
    state: State,
    scan: Scan,
    gain: float,
    model: Model,
    assets: Assets,
    params: Params,
    rng: np.random.Generator,
) -> State:
    """Particles around the optimum of a scan match join those of the believed place, whose mass they share."""
    own, prior = state.believed, np.exp(state.log_w)
    around = proposal.gaussian_of(state.pose[own], prior[own])
    if around.cov[0, 0] + around.cov[1, 1] > _MODE_M**2:
        return state  # not yet one place
    found = proposal.match(around, scan, assets.field, model, gain)
    pose, importance = proposal.draw(around, found, params.match_samples, params.match_slip, rng)
    mass, count = float(prior[own].sum()), pose.shape[0]
    share = count / (count + own.sum())
    reliability = np.full(count, float(prior[own] @ state.reliability[own]) / mass)
    state = state._replace(log_w=state.log_w + np.where(own, np.log1p(-share), 0.0))
    return _joined(state, pose, importance + np.log(share * mass / count), reliability, np.ones(count, np.bool_))


def _joined(
    state: State,
    pose: NDArray[np.float64],
    log_w: NDArray[np.float64],
    reliability: NDArray[np.float64],
    believed: NDArray[np.bool_],
) -> State:
    """The particles and more of them, weights on one scale."""
    return state._replace(
        pose=np.concatenate([state.pose, pose]),
        log_w=np.concatenate([state.log_w, log_w]),
        reliability=np.concatenate([state.reliability, reliability]),
        believed=np.concatenate([state.believed, believed]),
    )


def _conclude(
    state: State,
    sweep: Sweep,
    scan: Scan,
    model: Model,
    assets: Assets,
    params: Params,
    draw: Draw,
    done: tuple[int, int, float],
) -> tuple[State, Info]:
    """Estimate pose, classes and success, record, resample from the union. done: samples drawn, matches, share that
    is new."""
    drawn, matches, new = done
    weights, log_evidence = normalize(state.log_w)
    found = estimate.densest(state.pose, weights, _MODE_M, _MODE_RAD)
    inside = estimate.members(state.pose, found.pose, _MODE_M, _MODE_RAD)
    by_scan = float(weights[inside] @ state.reliability[inside])
    predicted = found.pose if state.predicted is None else state.predicted
    if not estimate.members(predicted[None], found.pose, _MODE_M, _MODE_RAD)[0]:
        state = state._replace(record=track_record.given_up(state.record, state.way_m))
    state = state._replace(record=track_record.trusted(state.record, by_scan), predicted=found.pose)
    counts = params.track_record and state.classifier is not None
    precision = track_record.precision(state.record, state.way_m) if counts else 1.0
    p_success = by_scan * precision
    fit = class_conditional.fit(found.pose[None], scan, assets.field, model)
    p_unknown, away = class_conditional.classes(found.pose, scan, assets.field, model)
    unknown = p_unknown >= params.unknown_threshold
    state.track.update(found.pose, found.cov)
    protection = protection_level_m(found.cov, p_success, assets.grid)
    state.records.add(sweep.stamp_ns, found.pose, p_success, protection, p_unknown, scan.ends[:, unknown], predicted)
    n_eff = float(effective_sample_size(weights))
    labels = np.where(state.reliability >= 0.5, 1, 0).astype(np.uint8)
    state.frames.offer(sweep.stamp_ns, found.pose, state.pose, scan.ends.T, labels)
    wanted = params.particles if found.mass >= 0.9 else start.UNSURE * params.particles
    count = int(inside.sum())
    resample = drawn > 0 or count > 2 * wanted or n_eff < params.resample_threshold * count
    info = Info(
        t_ns=sweep.stamp_ns,
        p_success=p_success,
        precision=precision,
        protection_m=protection,
        mae_m=float(fit.mae_m[0]),
        hits=float(fit.hits[0]),
        through=float(fit.through[0]),
        unknown_share=float(unknown.mean()),
        misaligned=misaligned_share(away, params.sigma_hit_m),
        mode_share=found.mass,
        sd_m=float(np.sqrt(found.cov[0, 0] + found.cov[1, 1])),
        n_eff=n_eff,
        gl_drawn=drawn,
        gl_matches=matches,
        gl_mass=float(weights[weights.size - drawn :].sum()) if drawn else 0.0,
        new_share=new,
        log_evidence=log_evidence,
        resampled=bool(resample),
        way_m=state.way_m,
        beams=scan.range_m.size,
    )
    if not resample:
        return state._replace(log_w=np.log(np.maximum(weights, 1e-300)), believed=np.asarray(inside)), info
    u = draw(Purpose.RESAMPLE, sweep.stamp_ns).random(2)
    return _resample(state, weights, inside, wanted, params.rivals, u), info


def _resample(
    state: State,
    weights: NDArray[np.float64],
    inside: NDArray[np.bool_],
    wanted: int,
    rivals: int,
    u: NDArray[np.float64],
) -> State:
    """The hypothesis that is believed and its rivals, each on its own: a rival keeps its weight, however small, so that
    the evidence for it adds up from scan to scan instead of being resampled away."""
    chosen, log_w, believed = [], [], []
    for k, (members, most) in enumerate(((inside, wanted), (~inside, rivals))):
        index = np.flatnonzero(members)
        mass = float(weights[index].sum())
        if most == 0 or mass <= 1e-300:
            continue
        chosen.append(index[systematic.choose(weights[index], u[k], most)])
        log_w.append(np.full(most, np.log(mass / most)))
        believed.append(np.full(most, k == 0))
    index = np.concatenate(chosen)
    joined = np.concatenate(log_w)
    joined -= normalize(joined)[1]
    pose, reliability = state.pose[index], state.reliability[index]
    return state._replace(pose=pose, log_w=joined, reliability=reliability, believed=np.concatenate(believed))


def finish(state: State, assets: Assets, params: Params) -> Result:
    """Track with p(success) and protection level, recoveries, and what the map lacks."""
    records = state.records
    track = state.track.track(records.columns())
    learnt = state.classifier
    summary = {
        "updates": records.count,
        "recoveries": records.recoveries(),
        "p_success_at_end": round(records.p_success_at_end(), 4) if learnt else None,
        "key_points": int(assets.features.kind.size),
        "decision_accuracy": round(learnt.accuracy, 4) if learnt else None,
    }
    if params.use_gl and assets.features.kind.size == 0:
        summary["note"] = "the map has no key point: global samples were drawn uniformly"
    layers = {"unknown_obstacles": records.layer()}
    tables = {"beams": records.beams()} if params.beams_table else {}
    return Result(track, assets.grid, state.frames.frames(), summary, layers, tables, given_frame=True)


SYSTEM = System(
    name="localize-reliable",
    params=Params,
    info=Info,
    needs=(frozenset({"motion", "scan"}),),
    load=load,
    init=init,
    step=step,
    finish=finish,
)
