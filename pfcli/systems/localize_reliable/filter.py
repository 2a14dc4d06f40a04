"""Reliable Monte Carlo localisation: pose, beam classes and success together. Akai 2023 (akai2023reliable).

One update, in the paper's order (section 5): particles and reliabilities are predicted, global samples are drawn, both
sets are weighed by the class-conditional measurement model and the decision model, the pose, the classes of the beams and
the reliability are estimated, and the particles are resampled from the union.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate
from pfcli.core.geometry import compose
from pfcli.core.sensor.class_conditional import Scan
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.events import Sweep
from pfcli.rng import Draw, Purpose
from pfcli.systems.localize_reliable import (
    first_particles,
    key_scans,
    map_change,
    particle_set,
    scan_weights,
    success_report,
    trust_record,
)
from pfcli.systems.localize_reliable.map_change import MapChanges
from pfcli.systems.localize_reliable.map_models import Assets, Usable, gain_of, load, model_of, reach_m, usable_scan
from pfcli.systems.localize_reliable.params import Params
from pfcli.systems.localize_reliable.particle_set import MODE_M, MODE_RAD, Particles
from pfcli.systems.localize_reliable.run_tables import RunTables
from pfcli.systems.localize_reliable.scan_weights import Reading
from pfcli.systems.localize_reliable.success_decision import Classifier
from pfcli.systems.localize_reliable.success_report import Info
from pfcli.systems.localize_reliable.trust_record import TrackRecord
from pfcli.systems.shared.contract import Filter, Result
from pfcli.systems.shared.motion_gate import Step, step_noise, update_of
from pfcli.systems.shared.resampling import by_name
from pfcli.systems.shared.run_record import RunRecord

_CARRIED = 0.3
"""Share of a scan that is new, beyond what a turn brings, when the robot was carried or its wheels have slipped."""
_REMEMBERED, _EXPLAINED = 16, 6
"""Key scans that tell what is new, and the newest of them that another place must explain, at least."""


class State(NamedTuple):
    """Particles; predicted: where the last estimate (3,) is now by odometry; odometry (1, 3) of the last update; places that
    were trusted; key scans; what the map shows and is gone; stamp of the last global sampling; what was learnt of the map; what
    the end of the run needs."""

    particles: Particles | None
    predicted: NDArray[np.float64] | None
    odometry: NDArray[np.float64]
    way_m: float
    trust: TrackRecord
    history: list[key_scans.KeyScan]
    changes: MapChanges
    sampled_ns: int
    classifier: Classifier | None
    record: RunRecord
    tables: RunTables


def init(params: Params, assets: Assets, first: Sweep, draw: Draw) -> State:
    """Nothing is known before the first usable scan."""
    return State(
        particles=None,
        predicted=None,
        odometry=np.array([first.odometry], np.float64),
        way_m=0.0,
        trust=trust_record.TOLD if assets.initial.kind == "pose" else trust_record.NOTHING,
        history=[],
        changes=map_change.NOTHING,
        sampled_ns=-(1 << 62),
        classifier=None,
        record=RunRecord(),
        tables=RunTables(assets.grid, params.beams_table),
    )


def step(state: State, sweep: Sweep, assets: Assets, params: Params, draw: Draw) -> tuple[State, Info | None]:
    """Every scan is recorded; one that has moved far enough updates the filter."""
    update = update_of(state.record, state.odometry, sweep, params, usable_scan)
    if update is None:
        return state, None
    if state.particles is None:
        state = _begin(state, sweep, update.used.scan, assets, params, draw)
    else:
        state = _predict(state, state.particles, update.step.moved, sweep.stamp_ns, params, draw)
    state = state._replace(odometry=update.step.now, way_m=state.way_m + update.step.way_m)
    state, new = _noticed_carried(state, sweep, update.used.scan)
    state, counted = _found_gone(state, update.used.scan, update.step.way_m, assets, params)
    reading = _reading(state, sweep, update.used, counted, new, params)
    assert state.particles is not None
    after, matches = scan_weights.by_scan(state.particles, reading, state.classifier, assets, params, draw)
    if reading.due:
        state = state._replace(sampled_ns=sweep.stamp_ns)
    return _conclude(state, after, reading, update.step, (matches, new), assets, params, draw)


def _begin(state: State, sweep: Sweep, scan: Scan, assets: Assets, params: Params, draw: Draw) -> State:
    """The first particles, and what is learnt of the map."""
    model = model_of(params, reach_m(sweep, params))
    pose = first_particles.scatter(scan, model, assets, params, draw(Purpose.INIT, sweep.stamp_ns))
    learnt = first_particles.classifier_for(sweep, model, assets, params) if params.estimate_reliability else None
    return state._replace(particles=particle_set.begun(pose), classifier=learnt)


def _predict(
    state: State, before: Particles, moved: NDArray[np.float64], stamp_ns: int, params: Params, draw: Draw
) -> State:
    """Particles and the last estimate move."""
    decay = (params.decay_per_m2, params.decay_per_rad2)
    after = particle_set.predicted(before, moved, step_noise(moved, params), decay, draw(Purpose.MOTION, stamp_ns))
    there = None if state.predicted is None else compose(state.predicted[None], moved[None])[0]
    return state._replace(particles=after, predicted=there)


def _noticed_carried(state: State, sweep: Sweep, scan: Scan) -> tuple[State, float]:
    """Which share of the scan is new; where it is too much of it, earlier scans do not lie where odometry says."""
    new = key_scans.new_share(scan, state.odometry, state.history[-_REMEMBERED:])
    if new <= _CARRIED + key_scans.turned_share(sweep.scan, state.odometry, state.history):
        return state, new
    state.history.clear()
    trust, changes = trust_record.doubted(state.trust), map_change.forgotten(state.changes)
    return state._replace(changes=changes, trust=trust), new


def _found_gone(state: State, scan: Scan, way: float, assets: Assets, params: Params) -> tuple[State, Scan]:
    """What of a scan is evidence, and what it finds gone."""
    if state.predicted is None or state.classifier is None or not params.map_changes:
        return state, scan
    crossings = map_change.crossed(state.predicted, scan, assets.field)
    trusted = trust_record.outlasts_wrong(state.trust)
    after = map_change.noted(state.changes, crossings, state.way_m, way, trusted)
    return state._replace(changes=after), map_change.counted(scan, crossings, state.changes, state.way_m)


def _reading(state: State, sweep: Sweep, used: Usable, counted: Scan, new: float, params: Params) -> Reading:
    """The scan with the key scans before it, of which it becomes one."""
    gain = gain_of(params, used.scan)
    worth = min(1.0, new / gain) if params.new_only else 1.0
    key = key_scans.KeyScan(state.odometry, key_scans.placed(state.odometry, used.points), counted, worth)
    explained = max(_EXPLAINED, params.gl_steps + 1)
    key_scans.remember(state.history, key, max(_REMEMBERED, explained))
    return Reading(
        stamp_ns=sweep.stamp_ns,
        scan=used.scan,
        counted=counted,
        key=key,
        history=state.history[-explained:],
        model=model_of(params, reach_m(sweep, params)),
        gain=gain,
        due=_due(state, sweep.stamp_ns, params),
    )


def _due(state: State, stamp_ns: int, params: Params) -> bool:
    """Whether global samples are to be drawn."""
    if not params.use_gl or stamp_ns - state.sampled_ns < params.gl_period * 1e9:
        return False
    assert state.particles is not None
    return not params.gl_gate or float(np.exp(state.particles.log_w) @ state.particles.reliability) < 0.5


def _trusted(
    state: State, expected: NDArray[np.float64], pose: NDArray[np.float64], by_scan: float, way: float
) -> State:
    """The places that were trusted, after an estimate (3,) where odometry expected (3,) and a step of `way`. by_scan:
    p(success) by the scans."""
    if not estimate.members(expected[None], pose, MODE_M, MODE_RAD)[0]:
        trust, way = trust_record.given_up(state.trust, state.way_m), 0.0
        state = state._replace(trust=trust, changes=map_change.forgotten(state.changes))
    return state._replace(trust=trust_record.trusted(state.trust, by_scan, way))


def _conclude(
    state: State,
    after: Particles,
    reading: Reading,
    moved: Step,
    noted: tuple[int, float],
    assets: Assets,
    params: Params,
    draw: Draw,
) -> tuple[State, Info]:
    """Estimate pose, classes and success, record, resample from the union. noted: matches of key points, share of the scan
    that is new."""
    drawn = params.gl_samples if reading.due else 0
    weights, log_evidence = normalize(after.log_w)
    found = estimate.densest(after.pose, weights, MODE_M, MODE_RAD)
    inside = estimate.members(after.pose, found.pose, MODE_M, MODE_RAD)
    expected = found.pose if state.predicted is None else state.predicted
    by_scan = float(weights[inside] @ after.reliability[inside])
    state = _trusted(state, expected, found.pose, by_scan, 0.0 if state.predicted is None else moved.way_m)
    counts = params.track_record and state.classifier is not None
    precision = trust_record.precision(state.trust, state.way_m) if counts else 1.0
    says = success_report.judged(found, by_scan, precision, state.changes, reading, state.classifier, assets, params)
    state.record.report(
        found, after.pose, reading.scan.ends.T, np.where(after.reliability >= 0.5, 1, 0).astype(np.uint8)
    )
    state.tables.add(reading.stamp_ns, found.pose, says, reading.scan.ends, expected)
    n_eff, count = float(effective_sample_size(weights)), int(inside.sum())
    wanted = params.particles if found.mass >= 0.9 else first_particles.UNSURE * params.particles
    resample = drawn > 0 or count > 2 * wanted or n_eff < params.resample_threshold * count
    weighed = success_report.Weighed(
        drawn=drawn,
        matches=noted[0],
        drawn_mass=float(weights[weights.size - drawn :].sum()) if drawn else 0.0,
        new_share=noted[1],
        log_evidence=log_evidence,
        n_eff=n_eff,
        resampled=bool(resample),
        way_m=state.way_m,
    )
    info = success_report.row(found, says, weighed, state.changes, reading, params)
    if resample:
        choose = partial(by_name, params.resampler, rng=draw(Purpose.RESAMPLE, reading.stamp_ns))
        after = particle_set.resampled(after, weights, inside, wanted, params.rivals, choose)
    else:
        after = after._replace(log_w=np.log(np.maximum(weights, 1e-300)), believed=np.asarray(inside))
    return state._replace(particles=after, predicted=found.pose), info


def finish(state: State, assets: Assets, params: Params) -> Result:
    """Track with p(success) and protection level, recoveries, and what the map lacks."""
    tables, learnt = state.tables, state.classifier
    summary = {
        "updates": tables.count,
        "recoveries": tables.recoveries(),
        "p_success_at_end": round(tables.p_success_at_end(), 4) if learnt else None,
        "key_points": int(assets.features.kind.size),
        "decision_accuracy": round(learnt.accuracy, 4) if learnt else None,
    }
    if params.use_gl and assets.features.kind.size == 0:
        summary["note"] = "the map has no key point: global samples were drawn uniformly"
    return Result(
        track=state.record.poses(tables.columns()),
        grid=assets.grid,
        frames=state.record.frames(),
        summary=summary,
        layers={"unknown_obstacles": tables.layer()},
        tables={"beams": tables.beams()} if params.beams_table else {},
        given_frame=True,
    )


FILTER = Filter(info=Info, load=load, init=init, step=step, finish=finish)
