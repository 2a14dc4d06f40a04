"""Rao-Blackwellised grid SLAM with Gaussian distributed resampling. Zhang et al. 2016 (`papers.bib`: zhang2016gdr).

One update, in the paper's order (section 2.2): predict by odometry, match the scan against each particle's own map,
sample the improved proposal, weigh, resample with dispersal, draw the scan into the maps at the dispersed poses.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.grid import scan_match, tiles
from pfcli.core.grid.coarse_search import coarse
from pfcli.core.grid.scan_odometry import drawn
from pfcli.core.grid.scan_points import Points, beams_of
from pfcli.core.motion.odometry import information
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.dropped import Dropped
from pfcli.events import Sweep
from pfcli.rng import Draw, Purpose
from pfcli.systems.shared.contract import Filter, Frame, Job, Result
from pfcli.systems.shared.frame_keeper import FrameKeeper
from pfcli.systems.shared.motion_gate import noise_of, step_since
from pfcli.systems.shared.resampling import ancestors_of, dispersed
from pfcli.systems.shared.tile_map import grid_of
from pfcli.systems.slam_gdr import matching, path_smoother
from pfcli.systems.slam_gdr.ancestry import History
from pfcli.systems.slam_gdr.params import Params
from pfcli.systems.slam_gdr.proposal_kernels import covariance, sample_proposal
from pfcli.systems.slam_gdr.scanner_spread import Learnt, learnt


class Info(NamedTuple):
    """One update, as a row of `metrics.parquet`."""

    t_ns: int
    n_eff: float
    resampled: bool
    unique_ancestors: int
    log_evidence: float
    match_log_likelihood: float
    match_inliers: float
    coarse_starts: int
    proposal_sd_m: float
    particle_spread_m: float
    offspring_spread_m: float
    beams: int
    no_returns: int
    invalid_beams: int
    tiles: int


class State(NamedTuple):
    """pose (n, 3); log_w since the last resampling; score: log weight summed along the ancestry; odometry (1, 3) of
    the last update; the particles' maps; scans: of all updates, empty without smoothing."""

    pose: NDArray[np.float64]
    log_w: NDArray[np.float64]
    score: NDArray[np.float64]
    odometry: NDArray[np.float64]
    maps: tiles.Tiles
    history: History
    frames: FrameKeeper
    resamplings: int
    scans: list[tiles.Beams]


def init(params: Params, assets: Learnt, first: Sweep, draw: Draw) -> State:
    """All particles at the origin of the map, which is the pose of the first scan."""
    n = params.particles
    return State(
        pose=np.zeros((n, 3)),
        log_w=np.zeros(n),
        score=np.zeros(n),
        odometry=np.array([first.odometry], np.float64),
        maps=tiles.empty(n, assets.params.resolution_m),
        history=History(),
        frames=FrameKeeper(),
        resamplings=0,
        scans=[],
    )


def step(state: State, sweep: Sweep, assets: Learnt, params: Params, draw: Draw) -> tuple[State, Info | None]:
    """Every scan is recorded; one that has moved far enough updates the filter."""
    history, params = state.history, assets.params
    history.see(sweep)
    first = history.updates == 0
    now, moved, _, far = step_since(state.odometry, sweep.odometry, params)
    if not (first or far):
        return state, None
    points = matching.points(sweep, params)
    if points.ends.shape[0] == 0:
        return state, None
    return _update(state._replace(odometry=now), sweep, points, None if first else moved, params, draw)


def _update(
    state: State, sweep: Sweep, points: Points, moved: NDArray[np.float64] | None, params: Params, draw: Draw
) -> tuple[State, Info]:
    n = params.particles
    ancestors, resampled, n_eff, evidence, spread = np.arange(n), False, float(n), 0.0, 0.0
    match, sd = None, np.zeros(n)
    if moved is not None:
        match = _match(state, moved, points, params)
        z = draw(Purpose.PROPOSAL, sweep.stamp_ns).standard_normal((n, 3))
        pose, half_log_det, sd = sample_proposal(match.pose, match.information, params.proposal_scale, z)
        gain = params.evidence_gain * (match.log_likelihood + match.log_prior + half_log_det)
        weights, evidence = normalize(state.log_w + gain)
        n_eff = float(effective_sample_size(weights))
        state = state._replace(pose=pose, log_w=state.log_w + gain, score=state.score + gain)
        if n > 1 and n_eff < params.resample_threshold * n:
            ancestors, resampled = ancestors_of(weights, params, draw, sweep.stamp_ns), True
            before = state.pose[ancestors]
            state = _resample(state, ancestors, weights, params, draw, sweep.stamp_ns)
            spread = float(np.sqrt(((state.pose - before)[:, :2] ** 2).sum(axis=1).mean()))
    fits = np.ones(n, bool) if match is None else (match.inliers < 0) | (match.inliers >= params.draw_inliers)
    beams = beams_of(points, sweep.scan.mount)
    if params.smooth:
        state.scans.append(beams)
    # section 2.2, step 6: at the dispersed poses; a scan that contradicts a particle's map is left out of it
    maps = tiles.draw(state.maps, state.pose, fits[ancestors], beams)
    state = state._replace(maps=maps, resamplings=state.resamplings + resampled)
    spread_of = covariance(state.pose)
    state.history.update(state.pose, ancestors, spread_of)
    state.frames.offer(sweep.stamp_ns, state.pose[int(np.argmax(state.score))], state.pose, points.ends)
    info = Info(
        t_ns=sweep.stamp_ns,
        n_eff=n_eff,
        resampled=resampled,
        unique_ancestors=np.unique(ancestors).size,
        log_evidence=float(evidence),
        match_log_likelihood=float(match.log_likelihood.mean()) if match else 0.0,
        match_inliers=float(match.inliers.mean()) if match else -1.0,
        coarse_starts=int(match.second.sum()) if match else 0,
        proposal_sd_m=float(sd.mean()),
        particle_spread_m=float(np.sqrt(spread_of[0, 0] + spread_of[1, 1])),
        offspring_spread_m=spread,
        beams=points.ends.shape[0],
        no_returns=points.no_returns,
        invalid_beams=points.invalid,
        tiles=tiles.used(state.maps),
    )
    return state, info


def _match(state: State, moved: NDArray[np.float64], points: Points, params: Params) -> scan_match.Match:
    """Predict by odometry, look around with the leading particle, refine every particle (sections 2.2, 1 and 2)."""
    noise, matcher = noise_of(params), matching.matcher(params)
    predicted = compose(state.pose, moved.reshape(1, 3))
    prior = information(moved, noise)
    near = matching.near(params)
    lead = int(np.argmax(state.score))
    corrections = np.tile(coarse(state.maps, lead, predicted[lead], points.ends, near), (params.particles, 1))
    match = scan_match.match(state.maps, predicted, prior, corrections, points.ends, matcher)
    lost = np.flatnonzero((match.inliers >= 0.0) & (match.inliers < params.rescue_inliers))
    if lost.size == 0:
        return match
    # the loop was missed or a wheel has slipped: such particles look around in their own map, farther
    wide = near._replace(half_xy_m=params.rescue_xy_m)
    for i in lost.tolist():
        corrections[i] = coarse(state.maps, i, predicted[i], points.ends, wide)
    return scan_match.match(state.maps, predicted, prior, corrections, points.ends, matcher)


def _resample(
    state: State, ancestors: NDArray[np.int64], weights: NDArray[np.float64], params: Params, draw: Draw, stamp_ns: int
) -> State:
    """Offspring take the map and history of their parent; GDR disperses them around it (eqs (7)-(8))."""
    n = params.particles
    pose = dispersed(state.pose, ancestors, weights, params, draw, stamp_ns)
    return state._replace(
        pose=pose, log_w=np.zeros(n), score=state.score[ancestors], maps=tiles.resample(state.maps, ancestors)
    )


def finish(state: State, assets: Learnt, params: Params) -> Result:
    """Track and map of the best particle: the one with the largest log weight summed along its ancestry."""
    history, params = state.history, assets.params
    best = int(np.argmax(state.score))
    path, covariance, grid, frames = history.path(best), history.covariance(), None, state.frames.frames()
    tables: dict[str, dict[str, Any]] = {}
    dropped: Dropped | None = None
    summary: dict[str, Any] = {
        "updates": history.updates,
        "resamplings": state.resamplings,
        "updates_shared_by_all": history.shared(),
        "tiles": tiles.used(state.maps),
        "map_mib": round(tiles.used(state.maps) * tiles.CELLS * 16 / 2**20, 1),
        "smoothed": params.smooth,
        **assets.reason,
    }
    if params.smooth:
        found = path_smoother.smooth(state.scans, history.steps_at, path, matching.setup(params))
        frames = _moved(frames, history.update_stamps(), path, found.path.poses)
        path, covariance = found.path.poses, found.path.covariance()
        grid = grid_of(drawn(state.scans, path, found.fits, params.resolution_m), 0)
        summary |= found.summary()
        dropped = found.dropped()
        tables = {"closures": found.table(history.update_stamps())}
    return Result(
        history.track(path, covariance),
        grid or grid_of(state.maps, best),
        frames,
        summary,
        tables=tables,
        dropped=dropped,
    )


def _moved(
    frames: list[Frame], stamps_ns: NDArray[np.int64], before: NDArray[np.float64], after: NDArray[np.float64]
) -> list[Frame]:
    """Frames that were kept on the way, moved as the poses of their updates were: `before` to `after` (m, 3)."""
    out = []
    for frame, k in zip(frames, np.searchsorted(stamps_ns, [f.stamp_ns for f in frames]).tolist(), strict=True):
        to = [compose(after[k : k + 1], between(before[k : k + 1], p)) for p in (frame.pose[None], frame.particles)]
        out.append(frame._replace(pose=to[0][0], particles=to[1]))
    return out


def load(params: Params, job: Job) -> Learnt:
    """What the log tells of its scanner."""
    return learnt(params, job.sweeps())


FILTER = Filter(info=Info, load=load, init=init, step=step, finish=finish)
