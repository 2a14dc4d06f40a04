"""Monte Carlo localisation in an incomplete map: six states, one particle cluster each. Zhang 2010 (zhang2010partial).

One update, in the paper's order: particles move and change class (section 2), entries are drawn at the frontiers
(definition 1), the classes' probabilities are predicted (eqs (2)-(12)), the scan weighs particles and classes
(eqs (13)-(23)), and each cluster is resampled on its own.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate, particles
from pfcli.core.grid import rolling_grid
from pfcli.core.grid.grid_map import GridMap
from pfcli.core.grid.region import region_of
from pfcli.core.grid.scan_points import Points, beams_of, points_of
from pfcli.core.grid.tiles import Beams
from pfcli.core.sensor import likelihood_field
from pfcli.errors import LogError, UsageError
from pfcli.events import Sweep
from pfcli.formats import map_yaml
from pfcli.initial import Initial
from pfcli.rng import Draw, Purpose
from pfcli.systems.localize_partial import class_smoother, pose_smoother, relocalise, update_corrected, update_paper
from pfcli.systems.localize_partial.class_belief import Assets, Belief, Past, Reading, in_the_map, share_in_map
from pfcli.systems.localize_partial.map_extension import extended
from pfcli.systems.localize_partial.matched_odometry import CELL_M, Reckoning, reckon
from pfcli.systems.localize_partial.params import Params
from pfcli.systems.shared.contract import Filter, Job, Result
from pfcli.systems.shared.frame_keeper import FrameKeeper
from pfcli.systems.shared.motion_gate import step_since
from pfcli.systems.shared.start_cells import start_cells
from pfcli.systems.shared.track_keeper import TrackKeeper

_MODE_M, _MODE_RAD = 0.75, 0.5
_MOST_BEAMS = 400
_PAST, _PAST_EVERY = 10, 2
"""Updates that are kept to ask them again where a robot may be in the map: every second one."""
_SURE = 0.9
"""Share of all mass at one place in the map, from which on the pose counts as known afterwards."""
_MOST_STARTS = 2_000_000
_NOVEL = 0.5
"""Share of a mismatch that is forgiven a beam which ends where nothing was ever hit before."""


class Info(NamedTuple):
    """One update, as a row of `metrics.parquet`; b1 .. b6: probabilities of the six states, p_ij of their transitions. b3 holds
    those too who are somewhere in the map without particles, so that n3 may be small where it is large."""

    t_ns: int
    b1: float
    b2: float
    b3: float
    b4: float
    b5: float
    b6: float
    p12: float
    p23: float
    p34: float
    p45: float
    p56: float
    p63: float
    n2: int
    n3: int
    n4: int
    n5: int
    n6: int
    n_eff: float
    log_evidence: float
    in_map: float
    mode_share: float
    sd_m: float
    way_m: float
    beams: int


class State(NamedTuple):
    """pose (n, 3), class (n,) of 2 .. 6 and global weight (n,) of each particle; b (7,): probabilities of the states,
    b[0]: see `Belief`; odometry (1, 3) of the last update; what the end of the run needs."""

    pose: NDArray[np.float64]
    label: NDArray[np.uint8]
    weight: NDArray[np.float64]
    b: NDArray[np.float64]
    odometry: NDArray[np.float64]
    reckoning: Reckoning
    way_m: float
    local: rolling_grid.LocalHistory
    track: TrackKeeper
    frames: FrameKeeper
    history: list[class_smoother.Step]
    stamps_ns: list[int]
    past: list[Past]
    reckoned: list[pose_smoother.Reckoned]
    scans: list[Beams]


def load(params: Params, job: Job) -> Assets:
    """Read the map. Raises LogError where nobody could be localised in it, UsageError for a start outside, or --no-smooth
    with --extend-map."""
    if params.extend_map and not params.smooth:
        raise UsageError("--extend-map draws where the whole log says that the robot was: leave out --no-smooth")
    grid = map_yaml.read(job.map_file, job.max_map_mpx)
    origin = grid.origin
    region = region_of(grid.cells, grid.resolution_m, origin, params.robot_radius_m, params.pocket_m2)
    if region.free_xy.size == 0:
        raise LogError(
            f"{job.map_file}: has no free cells that a robot of --robot-radius-m {params.robot_radius_m:g} fits into"
        )
    initial: Initial = job.initial
    if region.edge_xy.size == 0 and initial.kind != "inside":
        raise LogError(
            f"{job.map_file}: has no frontier (free cells beside unknown ones), so nobody can enter or leave it;"
            " say --initial inside, or lower --robot-radius-m or --pocket-m2"
        )
    model = likelihood_field.Model(params.sigma_hit_m, params.z_hit, params.reach_m)
    field = likelihood_field.build(grid.cells, grid.resolution_m, origin, model, unknown=params.model_unknown)
    return Assets(grid, region, field, initial, start_cells(region, initial, job.map_file))


def init(params: Params, assets: Assets, first: Sweep, draw: Draw) -> State:
    """The belief before the first scan, as `--initial` says."""
    rng = draw(Purpose.INIT, first.stamp_ns)
    kind = assets.initial.kind
    b = np.zeros(7)
    b[1], b[3] = {"unknown": (0.5, 0.5), "outside": (1.0, 0.0)}.get(kind, (0.0, 1.0))
    pose = np.empty((0, 3))
    if kind == "pose":
        pose = particles.gaussian(np.array(assets.initial.pose), np.array(assets.initial.sd), params.particles, rng)
    elif b[3] > 0.0:
        area = assets.start_xy.shape[0] * assets.grid.resolution_m**2
        n = int(min(max(params.particles, area * params.start_density_per_m2), _MOST_STARTS))
        pose = particles.uniform(assets.start_xy, assets.grid.resolution_m / 2, n, rng, assets.initial.heading)
    if kind in ("unknown", "inside") and assets.initial.heading is None and params.variant != "paper":
        b[0], b[3] = relocalise.MISSED * b[3], (1.0 - relocalise.MISSED) * b[3]
    n = pose.shape[0]
    return State(
        pose,
        np.full(n, 3, np.uint8),
        np.full(n, b[3] / max(1, n)),
        b,
        np.array([first.odometry], np.float64),
        Reckoning(),
        0.0,
        rolling_grid.empty(),
        TrackKeeper(),
        FrameKeeper(),
        [],
        [],
        [],
        [],
        [],
    )


def step(state: State, sweep: Sweep, assets: Assets, params: Params, draw: Draw) -> tuple[State, Info | None]:
    """Every scan is recorded; one that has moved far enough updates the filter."""
    state.track.see(sweep)
    first = not state.stamps_ns
    now, moved, way, far = step_since(state.odometry, sweep.odometry, params)
    if not (first or far):
        return state, None
    points = _points(sweep, params)
    if points.ends.shape[0] == 0:
        return state, None
    beams = beams_of(points, sweep.scan.mount)
    reckoning, moved = reckon(state.reckoning, beams, moved, way, params)
    if params.extend_map:
        state.scans.append(beams)
    state = state._replace(odometry=now, reckoning=reckoning, way_m=state.way_m + way)
    if reckoning.anew:
        state = state._replace(local=rolling_grid.empty(), past=[])
    scan = np.ascontiguousarray(points.ends.T, np.float32)
    ends = np.ascontiguousarray(scan[:, :: max(1, -(-scan.shape[1] // params.beams))])
    level = likelihood_field.levels_of(ends, params.sigma_hit_m, params.heading_sd_rad)
    base = _explained(state, ends, level, params)
    rolling_grid.remember(state.local, reckoning.pose, scan, state.way_m, params.history_m)
    update = update_paper.update if params.variant == "paper" else update_corrected.update
    reading = Reading(moved, first, ends, level, base, sweep.stamp_ns, reckoning.pose, state.past)
    belief = update(Belief(state.pose, state.label, state.weight, state.b), reading, assets, params, draw)
    if len(state.stamps_ns) % _PAST_EVERY == 0:
        state.past.append(Past(reckoning.pose, ends, level, base, belief.credit))
        del state.past[:-_PAST]
    state = state._replace(pose=belief.pose, label=belief.label, weight=belief.weight, b=belief.b)
    return _conclude(state, belief, sweep, ends)


def _points(sweep: Sweep, params: Params) -> Points:
    """The beams that returned within the usable range, thinned where there are many."""
    scan = sweep.scan
    stride = -(-scan.ranges_m.size // max(_MOST_BEAMS, params.beams)) or 1
    high = params.max_range_m or scan.range_max_m
    angles = (scan.angle_min_rad, scan.angle_increment_rad)
    return points_of(scan.ranges_m, angles, (scan.range_min_m, high), scan.mount, stride, 0.0, CELL_M)


def _explained(
    state: State, ends: NDArray[np.float32], level: NDArray[np.int32], params: Params
) -> NDArray[np.float32]:
    """Evidence that the last metres give to each beam: the map has to do better."""
    if not params.outside_likelihood or params.history_m == 0.0:
        return np.zeros((2, ends.shape[1]), np.float32)
    away = rolling_grid.explained_m(state.local, state.reckoning.pose, ends, state.way_m, params.history_m)
    model = likelihood_field.Model(params.sigma_hit_m, params.z_hit, params.reach_m)
    base = np.maximum(0.0, likelihood_field.log_ratio(away, model, level) - params.history_margin)
    # not seen often enough: a passer-by or the first sight of a wall; half an argument against the map, then none
    passing = base[1] == 0.0
    base[1, passing] = np.log(1.0 - params.z_hit) * np.where(base[0, passing] > 0.0, 1.0, _NOVEL)
    return base.astype(np.float32)


def _conclude(state: State, belief: Belief, sweep: Sweep, ends: NDArray[np.float32]) -> tuple[State, Info]:
    """Estimate and record."""
    b = belief.b
    inside = in_the_map(belief.label)
    in_map = float(share_in_map(b))
    nowhere = estimate.PoseEstimate(np.full(3, np.nan), np.full((3, 3), np.nan), 0.0)
    found = nowhere
    if inside.any() and in_map >= 0.5 and b[0] < in_map / 2:
        found = estimate.densest(belief.pose[inside], belief.weight[inside], _MODE_M, _MODE_RAD)
    elif in_map < 0.5 and b[4] + b[5] > b[1]:
        found = estimate.whole(belief.pose[~inside], belief.weight[~inside])
    state.track.update(found.pose, found.cov)
    state.stamps_ns.append(sweep.stamp_ns)
    state.history.append(class_smoother.Step(belief.transition, b))
    counts = np.bincount(belief.label, minlength=7)
    t = belief.transition
    rows = t.sum(axis=1)
    share = np.divide(t, rows[:, None], out=np.zeros((7, 7)), where=rows[:, None] > 0)
    state.frames.offer(sweep.stamp_ns, found.pose, belief.pose, ends.T, belief.label)
    known = in_map >= 0.5 and bool(inside.any())
    sure, reckoning = known and found.mass >= _SURE, state.reckoning
    fits = reckoning.astray_m == 0.0 and not reckoning.anew
    state.reckoned.append(
        pose_smoother.Reckoned(reckoning.pose, fits, reckoning.anew, bool(b[0] >= 0.5), found.pose, sure, state.way_m)
    )
    shares: dict[str, Any] = {f"b{k}": float(b[k]) for k in range(1, 7)}
    shares["b3"] += float(b[0])
    shares |= {f"p{i}{j}": float(share[i, j]) for i, j in ((1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 3))}
    shares |= {f"n{k}": int(counts[k]) for k in range(2, 7)}
    variance = found.cov[0, 0] + found.cov[1, 1]
    info = Info(
        t_ns=sweep.stamp_ns,
        **shares,
        n_eff=belief.n_eff,
        log_evidence=belief.log_evidence,
        in_map=in_map,
        mode_share=found.mass / in_map if known else 0.0,
        sd_m=float(np.sqrt(variance)) if np.isfinite(variance) else np.inf,
        way_m=state.way_m,
        beams=ends.shape[1],
    )
    return state, info


def finish(state: State, assets: Assets, params: Params) -> Result:
    """Track with the probability of being in the map, entries and exits."""
    in_map = share_in_map(np.array([kept.b for kept in state.history]))
    columns = {"in_map": in_map}
    layers: dict[str, GridMap] = {}
    if params.smooth:
        smoothed = class_smoother.backward(state.history)
        for k in range(1, 7):
            columns[f"b{k}_smoothed"] = smoothed[:, k] + (smoothed[:, 0] if k == 3 else 0.0)
        in_map = share_in_map(smoothed)
        columns["in_map_smoothed"] = in_map
    track = state.track.track(columns)
    if params.smooth:
        poses = pose_smoother.poses(state.reckoned, in_map)
        state.track.replace(poses, np.full((len(poses), 3, 3), np.nan))
        known = state.track.track({}).poses
        names = ("x_smoothed_m", "y_smoothed_m", "yaw_smoothed_rad")
        track = track._replace(columns=track.columns | dict(zip(names, known.T, strict=True)))
        if params.extend_map:
            layers["extended"] = extended(assets.grid, state.scans, poses)
    summary = {
        "updates": len(state.stamps_ns),
        "crossings": class_smoother.crossings(np.array(state.stamps_ns), in_map),
        "in_map_at_end": round(float(in_map[-1]), 4),
        "particles_at_end": int(state.pose.shape[0]),
    }
    return Result(track, assets.grid, state.frames.frames(), summary, layers, given_frame=True)


FILTER = Filter(info=Info, load=load, init=init, step=step, finish=finish)
