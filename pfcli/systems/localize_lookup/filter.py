"""Global localisation with headings from one match and ranges from a table. Zhang 2014 (zhang2014lookup).

One update, in the paper's order: particles move (eq. (10)), expected ranges are looked up and compared (eq. (13)), the
best particle is reported, particles are drawn anew. The first reading gives the particles their headings (eq. (12)).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate
from pfcli.core.grid import raycast
from pfcli.core.grid.region import region_of
from pfcli.core.motion.odometry import predict
from pfcli.core.resample import multinomial, systematic
from pfcli.core.sensor import range_beams, range_table
from pfcli.core.sensor.range_beams import Beams, Model
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.errors import LogError, UsageError
from pfcli.events import Sounding, Sweep
from pfcli.formats import map_yaml, range_table_file
from pfcli.initial import Initial
from pfcli.rng import Draw, Purpose
from pfcli.systems.localize_lookup import smc_start
from pfcli.systems.localize_lookup.params import Params
from pfcli.systems.localize_lookup.reading_beams import Assets, beams_of, evidence, model_of
from pfcli.systems.shared.contract import Filter, Job, Result
from pfcli.systems.shared.frame_keeper import FrameKeeper
from pfcli.systems.shared.motion_gate import step_noise, step_since
from pfcli.systems.shared.start_cells import start_cells
from pfcli.systems.shared.track_keeper import TrackKeeper

_MODE_M, _MODE_RAD = 0.75, 0.5
_CERTAIN, _CERTAIN_M = 0.8, 0.3
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
    readings, fading, as a share of the best there could be; what the end needs."""

    pose: NDArray[np.float64]
    log_w: NDArray[np.float64]
    odometry: NDArray[np.float64]
    way_m: float
    fit: float
    track: TrackKeeper
    frames: FrameKeeper
    certain_ns: list[int]
    looks: list[int]


def load(params: Params, job: Job) -> Assets:
    """Read the map and its table. Raises LogError where nobody could stand in it, UsageError for a start outside or shares of
    beams that are more than all."""
    if params.z_hit + params.z_short + params.z_none >= 1.0:
        raise UsageError("--z-hit, --z-short and --z-none must leave something of 1 for beams that read anything")
    grid = map_yaml.read(job.map_file, job.max_map_mpx)
    region = region_of(grid.cells, grid.resolution_m, grid.origin, 0.0)
    if region.free_xy.size == 0:
        raise LogError(f"{job.map_file}: has no free cells")
    if not (grid.cells == 1).any():
        raise LogError(f"{job.map_file}: has no occupied cells, so no range can be expected of it")
    initial: Initial = job.initial
    if initial.kind == "outside":
        raise UsageError("--initial outside: localize-lookup knows no outside; localize-partial does")
    seen = grid._replace(cells=raycast.unveiled(grid.cells, grid.resolution_m, params.veil_m))
    rays = range_beams.rays_of(seen.cells, grid.resolution_m, grid.origin, params.table_range_m)
    table, source = None, "rays"
    needed = range_table.bytes_of(seen.cells, params.bins) / 2**20
    if params.ranges == "table" and needed > params.table_budget_mib:
        source = f"rays: the table would take {needed:.0f} MiB, more than --table-budget-mib"
    elif params.ranges == "table":
        loaded = range_table_file.load(seen, params.bins, params.table_range_m)
        table, source = loaded.table, f"table, {loaded.origin}"
    return Assets(
        grid,
        start_cells(region, initial, job.map_file),
        region.free_xy,
        rays,
        table,
        initial,
        source,
        raycast.wall_thickness_m(grid.cells, grid.resolution_m),
    )


def init(params: Params, assets: Assets, first: Sweep | Sounding, draw: Draw) -> State:
    """Nothing is known before the first usable reading."""
    nothing = np.empty((0, 3))
    return State(nothing, np.empty(0), np.array([first.odometry]), 0.0, 1.0, TrackKeeper(), FrameKeeper(), [], [])


def step(
    state: State, reading: Sweep | Sounding, assets: Assets, params: Params, draw: Draw
) -> tuple[State, Info | None]:
    """Every reading is recorded; one that has moved far enough updates the filter."""
    state.track.see(reading)
    first = state.pose.shape[0] == 0
    now, moved, way, far = step_since(state.odometry, reading.odometry, params)
    if not (first or far):
        return state, None
    beams = beams_of(reading, params)
    if beams.turn.size == 0:
        return state, None
    if first:
        pose, log_w, _ = smc_start.scatter(beams, assets, params, draw(Purpose.INIT, reading.stamp_ns))
        state = state._replace(pose=pose, log_w=log_w)
    else:
        z = draw(Purpose.MOTION, reading.stamp_ns).standard_normal(state.pose.shape)
        pose = predict(state.pose, moved, step_noise(moved, params), z)
        model = model_of(params, beams, assets, params.sigma_hit_m)
        state = state._replace(pose=pose, log_w=state.log_w + evidence(pose, beams, assets, model))
        if params.variant == "corrected" and params.lost_share > 0.0:
            state = _look_around_if_lost(state, reading.stamp_ns, beams, model, assets, params, draw)
    state = state._replace(odometry=now, way_m=state.way_m + way)
    return _conclude(state, reading, beams, assets, params, draw)


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
    state: State, reading: Sweep | Sounding, beams: Beams, assets: Assets, params: Params, draw: Draw
) -> tuple[State, Info]:
    """Report, then resample."""
    pose = state.pose
    weights, log_evidence = normalize(state.log_w)
    found = estimate.densest(pose, weights, _MODE_M, _MODE_RAD)
    if params.variant == "paper":
        found = found._replace(pose=pose[int(np.argmax(weights))].copy())
    sd_m, sd_yaw = float(np.sqrt(found.cov[0, 0] + found.cov[1, 1])), float(np.sqrt(found.cov[2, 2]))
    state.track.update(found.pose, found.cov)
    if found.mass >= _CERTAIN and sd_m <= _CERTAIN_M:
        state.certain_ns.append(reading.stamp_ns)
    n_eff = float(effective_sample_size(weights))
    crowded = pose.shape[0] > params.particles
    resample = params.variant == "paper" or crowded or n_eff < params.resample_threshold * pose.shape[0]
    state.frames.offer(reading.stamp_ns, found.pose, pose[np.argsort(-weights, kind="stable")], _ends(beams))
    info = Info(
        t_ns=reading.stamp_ns,
        best_log_w=float(state.log_w.max()),
        mode_share=found.mass,
        modes=estimate.modes(pose, weights, _MODE_M, _MODE_RAD),
        sd_m=sd_m,
        sd_yaw_rad=sd_yaw,
        n_eff=n_eff,
        missed=range_beams.misses(pose, beams, assets.rays),
        log_evidence=log_evidence,
        resampled=bool(resample),
        way_m=state.way_m,
        beams=beams.turn.size,
    )
    if not resample:
        return state._replace(log_w=state.log_w - log_evidence), info
    rng = draw(Purpose.RESAMPLE, reading.stamp_ns)
    if params.variant == "paper":
        chosen = multinomial.ancestors(weights, rng.random(params.particles))
    else:
        chosen = systematic.choose(weights, rng.random(), params.particles)
    n = chosen.size
    return state._replace(pose=pose[chosen], log_w=np.full(n, -np.log(n))), info


def _ends(beams: Beams) -> NDArray[np.float32]:
    """End points (b, 2) of the beams that returned, base frame."""
    origin = np.repeat(beams.mounts[:, :2], np.diff(beams.start), axis=0)
    back = np.isfinite(beams.range_m)
    return np.asarray((origin + (beams.range_m * beams.unit).T)[back], np.float32)


def finish(state: State, assets: Assets, params: Params) -> Result:
    """Track, and since when the filter was certain."""
    track = state.track.track({})
    since = (state.certain_ns[0] - int(track.stamps_ns[0])) * 1e-9 if state.certain_ns else None
    summary = {
        "updates": int(track.columns["update"].sum()),
        "ranges": assets.source,
        "certain_since_s": None if since is None else round(since, 3),
        "looks_around": len(state.looks),
        "particles": int(state.pose.shape[0]),
    }
    return Result(track, assets.grid, state.frames.frames(), summary, given_frame=True)


FILTER = Filter(info=Info, load=load, init=init, step=step, finish=finish)
