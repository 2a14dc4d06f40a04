"""Global localisation with headings from one match and ranges from a table. Zhang 2014 (zhang2014lookup).

One update, in the paper's order: particles move (eq. (10)), expected ranges are looked up and compared (eq. (13)), the
best particle is reported, particles are drawn anew. The first reading gives the particles their headings (eq. (12)).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate
from pfcli.core.geometry import compose
from pfcli.core.motion.odometry import predict
from pfcli.core.sensor import range_beams
from pfcli.core.sensor.range_beams import Beams, Model
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.events import Sounding, Sweep
from pfcli.initial import Initial
from pfcli.rng import Draw, Purpose
from pfcli.systems.localize_lookup import certainty, smc_start
from pfcli.systems.localize_lookup.certainty import MODE_M, MODE_RAD, Certainty
from pfcli.systems.localize_lookup.expected_ranges import Assets, evidence, load
from pfcli.systems.localize_lookup.params import Params
from pfcli.systems.localize_lookup.reading_beams import beams_of, ends_of, model_of
from pfcli.systems.shared import resampling
from pfcli.systems.shared.contract import Filter, Result
from pfcli.systems.shared.motion_gate import step_noise, update_of
from pfcli.systems.shared.run_record import RunRecord

_FADING = 0.2
"""Weight of the newest reading in `fit`: one glance at a crowd is no reason to think oneself lost."""


class Info(NamedTuple):
    """One update, as a row of `metrics.parquet`; missed: share of the particles whose sensor stands in no free cell."""

    t_ns: int
    best_log_w: float
    mode_share: float
    modes: int
    sd_m: float
    sd_yaw_rad: float
    n_eff: float
    missed: float
    log_evidence: float
    resampled: bool
    way_m: float
    beams: int


class State(NamedTuple):
    """pose (n, 3) and log weight (n,) of each particle; odometry (1, 3) of the last update; fit: log evidence of the last
    readings, fading, as a share of the best there could be; the last estimate (3,); what the end needs."""

    pose: NDArray[np.float64]
    log_w: NDArray[np.float64]
    odometry: NDArray[np.float64]
    way_m: float
    fit: float
    record: RunRecord
    estimate: NDArray[np.float64] | None
    certainty: Certainty
    looks: list[int]


def init(params: Params, assets: Assets, first: Sweep | Sounding, draw: Draw) -> State:
    """Nothing is known before the first usable reading."""
    return State(
        pose=np.empty((0, 3)),
        log_w=np.empty(0),
        odometry=np.array([first.odometry]),
        way_m=0.0,
        fit=1.0,
        record=RunRecord(),
        estimate=None,
        certainty=Certainty(),
        looks=[],
    )


def step(
    state: State, reading: Sweep | Sounding, assets: Assets, params: Params, draw: Draw
) -> tuple[State, Info | None]:
    """Every reading is recorded; one that has moved far enough updates the filter."""
    update = update_of(state.record, state.odometry, reading, params, beams_of)
    if update is None:
        return state, None
    beams, moved = update.used, update.step.moved
    if update.first:
        pose, log_w, _ = smc_start.scatter(beams, assets, params, draw(Purpose.INIT, reading.stamp_ns))  # eq. (12)
        state = state._replace(pose=pose, log_w=log_w)
    else:
        z = draw(Purpose.MOTION, reading.stamp_ns).standard_normal(state.pose.shape)
        pose = predict(state.pose, moved, step_noise(moved, params), z)  # eq. (10)
        model = model_of(params, beams, assets, params.sigma_hit_m)
        state = state._replace(pose=pose, log_w=state.log_w + evidence(pose, beams, assets, model))  # eq. (13)
        if params.variant == "corrected" and params.lost_share > 0.0:
            state = _look_around_if_lost(state, reading.stamp_ns, beams, model, assets, params, draw)
    expected = None if state.estimate is None else compose(state.estimate[None], moved[None])[0]
    state = state._replace(odometry=update.step.now, way_m=state.way_m + update.step.way_m, estimate=expected)
    return _conclude(state, reading.stamp_ns, beams, assets, params, draw)


def _look_around_if_lost(
    state: State, stamp_ns: int, beams: Beams, model: Model, assets: Assets, params: Params, draw: Draw
) -> State:
    """Where the last readings fit badly, the particles get company of those of a robot that may be anywhere: each side by
    its prior and its evidence."""
    best = model.gain * float(model.score.max()) * beams.turn.size
    fit = state.fit if best <= 0.0 else state.fit + _FADING * (normalize(state.log_w)[1] / best - state.fit)
    if fit >= params.lost_fit:
        return state._replace(fit=fit)
    # what held at the start need not hold now: neither its region nor its heading
    whole = assets._replace(start_xy=assets.free_xy, initial=Initial("inside"))
    found = smc_start.anywhere(beams, whole, params, draw(Purpose.INJECT, stamp_ns))
    state.looks.append(stamp_ns)
    _, log_sum = normalize(found.log_w)
    fresh = found.log_w - log_sum + found.log_evidence + np.log(params.lost_share)
    return state._replace(
        pose=np.concatenate([state.pose, found.pose]),
        log_w=np.concatenate([state.log_w + np.log(1.0 - params.lost_share), fresh]),
        fit=1.0,
    )


def _conclude(
    state: State, stamp_ns: int, beams: Beams, assets: Assets, params: Params, draw: Draw
) -> tuple[State, Info]:
    """Report, then resample."""
    pose = state.pose
    weights, log_evidence = normalize(state.log_w)
    found = estimate.densest(pose, weights, MODE_M, MODE_RAD)
    if params.variant == "paper":
        found = found._replace(pose=pose[int(np.argmax(weights))].copy())
    state.record.report(found, pose[np.argsort(-weights, kind="stable")], ends_of(beams))
    looked = bool(state.looks) and state.looks[-1] == stamp_ns
    known = certainty.after(state.certainty, found, state.estimate, looked, stamp_ns)
    state = state._replace(estimate=found.pose, certainty=known)
    n_eff = float(effective_sample_size(weights))
    chosen = resampling.chosen(weights, n_eff, params, draw, stamp_ns)
    info = Info(
        t_ns=stamp_ns,
        best_log_w=float(state.log_w.max()),
        mode_share=found.mass,
        modes=estimate.modes(pose, weights, MODE_M, MODE_RAD),
        sd_m=found.sd_m,
        sd_yaw_rad=found.sd_yaw_rad,
        n_eff=n_eff,
        missed=range_beams.misses(pose, beams, assets.rays),
        log_evidence=log_evidence,
        resampled=chosen is not None,
        way_m=state.way_m,
        beams=beams.turn.size,
    )
    if chosen is None:
        return state._replace(log_w=state.log_w - log_evidence), info
    n = chosen.size
    return state._replace(pose=pose[chosen], log_w=np.full(n, -np.log(n))), info


def finish(state: State, assets: Assets, params: Params) -> Result:
    """Track, and since when the filter was certain."""
    track = state.record.poses()
    summary = {
        "updates": int(track.columns["update"].sum()),
        "ranges": assets.source,
        **certainty.summary(state.certainty, int(track.stamps_ns[0])),
        "looks_around": len(state.looks),
        "particles": int(state.pose.shape[0]),
    }
    return Result(track=track, grid=assets.grid, frames=state.record.frames(), summary=summary, given_frame=True)


FILTER = Filter(info=Info, load=load, init=init, step=step, finish=finish)
