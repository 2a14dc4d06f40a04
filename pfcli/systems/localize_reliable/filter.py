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
from pfcli.core.sensor import class_conditional
from pfcli.core.sensor.class_conditional import Fit, Scan
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.events import Sweep
from pfcli.rng import Draw, Purpose
from pfcli.systems.localize_reliable import first_particles, key_scans, scan_weights, success_decision, trust_record
from pfcli.systems.localize_reliable import map_change as gone
from pfcli.systems.localize_reliable import particle_set as cloud
from pfcli.systems.localize_reliable.map_change import Gone
from pfcli.systems.localize_reliable.map_models import Assets, gain_of, load, model_of, reach_m, scan_of
from pfcli.systems.localize_reliable.misalignment import misaligned_share
from pfcli.systems.localize_reliable.params import Params
from pfcli.systems.localize_reliable.particle_set import MODE_M, MODE_RAD, Cloud
from pfcli.systems.localize_reliable.protection_level import protection_level_m, surface_variance
from pfcli.systems.localize_reliable.run_tables import Records
from pfcli.systems.localize_reliable.scan_weights import Reading
from pfcli.systems.localize_reliable.success_decision import Classifier
from pfcli.systems.localize_reliable.trust_record import TrackRecord
from pfcli.systems.shared.contract import Filter, Result
from pfcli.systems.shared.frame_keeper import FrameKeeper
from pfcli.systems.shared.motion_gate import step_noise, step_since
from pfcli.systems.shared.track_keeper import TrackKeeper

_CARRIED = 0.3
"""Share of a scan that is new, beyond what a turn brings, when the robot was carried or its wheels have slipped."""
_REMEMBERED, _EXPLAINED = 16, 6
"""Key scans that tell what is new, and the newest of them that another place must explain, at least."""


class Info(NamedTuple):
    """One update, as a row of `metrics.parquet`; precision: P(a place is right that is trusted and was kept so long), a
    factor of p_success; mae_m, hits, through, unknown_share, misaligned: of the scan at the
    estimate; gl_*: global samples drawn, their matches of key points, and their share of the mass; new_share: of the beams,
    that no key scan showed before; gone: share of the beams, over the last metres, that read far beyond a mapped surface."""

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
    gone: float
    log_evidence: float
    resampled: bool
    way_m: float
    beams: int


class State(NamedTuple):
    """Particles; predicted: where the last estimate (3,) is now by odometry; odometry (1, 3) of the last update; places that
    were trusted; key scans; what the map shows and is gone; stamp of the last global sampling; what was learnt of the map; what
    the end of the run needs."""

    cloud: Cloud | None
    predicted: NDArray[np.float64] | None
    odometry: NDArray[np.float64]
    way_m: float
    record: TrackRecord
    history: list[key_scans.KeyScan]
    gone: Gone
    sampled_ns: int
    classifier: Classifier | None
    track: TrackKeeper
    frames: FrameKeeper
    records: Records


def init(params: Params, assets: Assets, first: Sweep, draw: Draw) -> State:
    """Nothing is known before the first usable scan."""
    return State(
        None,
        None,
        np.array([first.odometry], np.float64),
        0.0,
        trust_record.TOLD if assets.initial.kind == "pose" else trust_record.NOTHING,
        [],
        gone.NOTHING,
        -(1 << 62),
        None,
        TrackKeeper(),
        FrameKeeper(),
        Records(assets.grid, params.beams_table),
    )


def step(state: State, sweep: Sweep, assets: Assets, params: Params, draw: Draw) -> tuple[State, Info | None]:
    """Every scan is recorded; one that has moved far enough updates the filter."""
    state.track.see(sweep)
    now, moved, way, far = step_since(state.odometry, sweep.odometry, params)
    if not (far or state.cloud is None):
        return state, None
    scan, points = scan_of(sweep, params)
    if scan.range_m.size == 0:
        return state, None
    model, gain = model_of(params, reach_m(sweep, params)), gain_of(params, scan)
    if state.cloud is None:
        pose = first_particles.scatter(scan, model, assets, params, draw(Purpose.INIT, sweep.stamp_ns))
        learnt = first_particles.classifier_for(sweep, model, assets, params) if params.estimate_reliability else None
        state = state._replace(cloud=cloud.begun(pose), classifier=learnt)
    else:
        state = _predict(state, state.cloud, moved, sweep.stamp_ns, params, draw)
    state = state._replace(odometry=now, way_m=state.way_m + way)
    new = key_scans.new_share(scan, now, state.history[-_REMEMBERED:])
    if new > _CARRIED + key_scans.turned_share(sweep.scan, now, state.history):
        state.history.clear()  # earlier scans do not lie where odometry says
        state = state._replace(gone=gone.forgotten(state.gone), record=trust_record.doubted(state.record))
    state, counted = _found_gone(state, scan, way, assets, params)
    worth = min(1.0, new / gain) if params.new_only else 1.0
    key = key_scans.KeyScan(now, key_scans.placed(now, points), counted, worth)
    explained = max(_EXPLAINED, params.gl_steps + 1)
    key_scans.remember(state.history, key, max(_REMEMBERED, explained))
    assert state.cloud is not None
    due = _due(state, state.cloud, sweep.stamp_ns, params)
    reading = Reading(sweep.stamp_ns, scan, counted, key, state.history[-explained:], model, gain, due)
    after, matches = scan_weights.by_scan(state.cloud, reading, state.classifier, assets, params, draw)
    if due:
        state = state._replace(sampled_ns=sweep.stamp_ns)
    return _conclude(state, after, reading, (matches, new, way), assets, params, draw)


def _predict(
    state: State, before: Cloud, moved: NDArray[np.float64], stamp_ns: int, params: Params, draw: Draw
) -> State:
    """Particles and the last estimate move."""
    decay = (params.decay_per_m2, params.decay_per_rad2)
    after = cloud.predicted(before, moved, step_noise(moved, params), decay, draw(Purpose.MOTION, stamp_ns))
    there = None if state.predicted is None else compose(state.predicted[None], moved[None])[0]
    return state._replace(cloud=after, predicted=there)


def _found_gone(state: State, scan: Scan, way: float, assets: Assets, params: Params) -> tuple[State, Scan]:
    """What of a scan is evidence, and what it finds gone."""
    if state.predicted is None or state.classifier is None or not params.map_changes:
        return state, scan
    crossings = gone.crossed(state.predicted, scan, assets.field)
    trusted = trust_record.outlasts_wrong(state.record)
    after = gone.noted(state.gone, crossings, state.way_m, way, trusted)
    return state._replace(gone=after), gone.counted(scan, crossings, state.gone, state.way_m)


def _due(state: State, before: Cloud, stamp_ns: int, params: Params) -> bool:
    """Whether global samples are to be drawn."""
    if not params.use_gl or stamp_ns - state.sampled_ns < params.gl_period * 1e9:
        return False
    return not params.gl_gate or float(np.exp(before.log_w) @ before.reliability) < 0.5


def _recorded(
    state: State, expected: NDArray[np.float64], pose: NDArray[np.float64], by_scan: float, way: float
) -> State:
    """The places that were trusted, after an estimate (3,) where odometry expected (3,) and a step of `way`. by_scan:
    p(success) by the scans."""
    if not estimate.members(expected[None], pose, MODE_M, MODE_RAD)[0]:
        record, way = trust_record.given_up(state.record, state.way_m), 0.0
        state = state._replace(record=record, gone=gone.forgotten(state.gone))
    return state._replace(record=trust_record.trusted(state.record, by_scan, way))


def _beyond_doubt(
    state: State,
    pose: NDArray[np.float64],
    by_scan: float,
    fit: Fit,
    reading: Reading,
    assets: Assets,
    params: Params,
) -> float:
    """p(success) by the scans that a bound in metres may rest on: beams through what is gone speak against it all the same,
    and there is none where the map does not hold. fit: of the whole scan at pose (3,)."""
    if not gone.map_holds(state.gone):
        return 0.0
    if state.classifier is None or reading.counted is reading.scan:
        return by_scan
    rest = class_conditional.fit(pose[None], reading.counted, assets.field, reading.model)
    ratio = success_decision.log_ratio(fit, state.classifier)[0] - success_decision.log_ratio(rest, state.classifier)[0]
    left = np.exp(min(0.0, params.decision_gain * float(ratio)))
    return float(by_scan * left / (by_scan * left + 1.0 - by_scan))


def _conclude(
    state: State,
    after: Cloud,
    reading: Reading,
    done: tuple[int, float, float],
    assets: Assets,
    params: Params,
    draw: Draw,
) -> tuple[State, Info]:
    """Estimate pose, classes and success, record, resample from the union. done: matches of key points, share of the scan
    that is new, way since the last update."""
    stamp_ns, scan, drawn = reading.stamp_ns, reading.scan, params.gl_samples if reading.due else 0
    weights, log_evidence = normalize(after.log_w)
    found = estimate.densest(after.pose, weights, MODE_M, MODE_RAD)
    inside = estimate.members(after.pose, found.pose, MODE_M, MODE_RAD)
    expected = found.pose if state.predicted is None else state.predicted
    by_scan = float(weights[inside] @ after.reliability[inside])
    state = _recorded(state, expected, found.pose, by_scan, 0.0 if state.predicted is None else done[2])
    counts = params.track_record and state.classifier is not None
    precision = trust_record.precision(state.record, state.way_m) if counts else 1.0
    p_success = by_scan * precision
    fit = class_conditional.fit(found.pose[None], scan, assets.field, reading.model)
    p_unknown, away = class_conditional.classes(found.pose, scan, assets.field, reading.model)
    unknown = p_unknown >= params.unknown_threshold
    state.track.update(found.pose, found.cov)
    safe = _beyond_doubt(state, found.pose, by_scan, fit, reading, assets, params) * precision
    protection = protection_level_m(found.cov, safe, assets.grid, surface_variance(away[p_unknown < 0.5]))
    state.records.add(stamp_ns, found.pose, p_success, protection, p_unknown, scan.ends[:, unknown], expected)
    n_eff = float(effective_sample_size(weights))
    labels = np.where(after.reliability >= 0.5, 1, 0).astype(np.uint8)
    state.frames.offer(stamp_ns, found.pose, after.pose, scan.ends.T, labels)
    wanted = params.particles if found.mass >= 0.9 else first_particles.UNSURE * params.particles
    count = int(inside.sum())
    resample = drawn > 0 or count > 2 * wanted or n_eff < params.resample_threshold * count
    info = Info(
        t_ns=stamp_ns,
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
        gl_matches=done[0],
        gl_mass=float(weights[weights.size - drawn :].sum()) if drawn else 0.0,
        new_share=done[1],
        gone=state.gone.share,
        log_evidence=log_evidence,
        resampled=bool(resample),
        way_m=state.way_m,
        beams=scan.range_m.size,
    )
    if resample:
        u = draw(Purpose.RESAMPLE, stamp_ns).random(2)
        after = cloud.resampled(after, weights, inside, wanted, params.rivals, u)
    else:
        after = after._replace(log_w=np.log(np.maximum(weights, 1e-300)), believed=np.asarray(inside))
    return state._replace(cloud=after, predicted=found.pose), info


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


FILTER = Filter(info=Info, load=load, init=init, step=step, finish=finish)
