"""A soccer robot on its field, from wheels, vision and compass. Zhang 2011 (zhang2011soccer).

Every frame of vision is an update: the particles roll with errors of their wheels (eqs (3)-(4)), some more are proposed
where the lines want them, all are weighed by points, landmarks and compass (eq. (9)), the estimate is reported, and
particles are drawn anew.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate
from pfcli.core.geometry import between, compose
from pfcli.core.motion import odometry, wheels
from pfcli.core.resample import multinomial, systematic
from pfcli.core.sensor import compass
from pfcli.core.sensor import known_landmarks as landmarks
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.events import Rolling, Sighting
from pfcli.formats import field_yaml
from pfcli.rng import Draw, Purpose
from pfcli.systems.fuse_soccer import line_proposal, start_on_field
from pfcli.systems.fuse_soccer.field_assets import Assets, View, load, view_of
from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.fuse_soccer.sighting_likelihood import Belief, Heard, choose_side, of_missed, turned, weigh
from pfcli.systems.shared.contract import Filter, Result
from pfcli.systems.shared.frame_keeper import FrameKeeper
from pfcli.systems.shared.motion_gate import step_noise
from pfcli.systems.shared.track_keeper import TrackKeeper

_CERTAIN, _CERTAIN_M = 0.8, 0.3
_FADING = 0.2
"""Weight of the newest frame in `fit`: one bad frame is no reason to think oneself lost."""
_LEARN_SD_RAD = 0.15
_REST_NS = 500_000_000
"""Who is still lost looks around again after this time."""
_CAUTIOUS, _ADAPT, _WILD = 20.0, 0.1, 30.0
"""The motion's variance at the start in units of its parameters, how fast it follows the surprises, and the largest that
counts."""


class Info(NamedTuple):
    """One frame, as a row of `metrics.parquet`.

    mirror_p: probability of the pose half a turn about the centre away; compass_residual_rad: reading less estimate, bias
    removed; slip_m: largest travel of a wheel that no motion explains; two_*: pose from two landmarks, NaN where there is none.
    """

    t_ns: int
    best_log_w: float
    mode_share: float
    modes: int
    mirror_p: float
    sd_m: float
    sd_yaw_rad: float
    n_eff: float
    log_evidence: float
    fit: float
    points: int
    landmarks: int
    compass_residual_rad: float
    compass_bias_rad: float
    compass_disturbed: bool
    slip_m: float
    injected: int
    refined: int
    resampled: bool
    way_m: float
    two_x_m: float
    two_y_m: float
    two_yaw_rad: float


class State(NamedTuple):
    """belief: particles; pose: (3,) the last estimate; last: sighting; begun_yaw_rad: odometry at the first one; bias of the
    compass; heard_ns: its last reading, 0 before; stretch: of the motion's variance; fit: evidence of the last frames and the
    best there could be, both fading; what the end needs."""

    belief: Belief
    pose: NDArray[np.float64]
    last: Sighting
    begun_yaw_rad: float
    bias: compass.Bias
    heard_ns: int
    stretch: float
    fit: tuple[float, float]
    way_m: float
    track: TrackKeeper
    frames: FrameKeeper
    mirror_p: list[float]
    certain_ns: list[int]
    injected_ns: list[int]


def init(params: Params, assets: Assets, first: Sighting, draw: Draw) -> State:
    """Nothing is known before the first frame."""
    nothing = Belief(np.empty((0, 3)), np.empty(0), np.empty(0))
    yaw = first.odometry[2]
    keepers = TrackKeeper(), FrameKeeper()
    adapts = params.adapt and params.vision and params.refine > 0.0 and params.variant == "corrected"
    stretch = _CAUTIOUS if adapts else 1.0
    return State(nothing, np.zeros(3), first, yaw, compass.Bias(), 0, stretch, (1.0, 1.0), 0.0, *keepers, [], [], [])


class _Glance(NamedTuple):
    """A frame on its way through an update; slip_m, surprise, injected and refined: see `Info` and `propose.beside`."""

    sighting: Sighting
    view: View
    heard: Heard | None
    seconds: float
    slip_m: float = 0.0
    surprise: float = 1.0
    refined: int = 0
    injected: int = 0


def step(state: State, sighting: Sighting, assets: Assets, params: Params, draw: Draw) -> tuple[State, Info | None]:
    """Every frame updates the filter, once there was something to start from."""
    state.track.see(sighting)
    view = view_of(sighting, assets, params)
    seconds = (sighting.stamp_ns - state.last.stamp_ns) * 1e-9
    heard = _heard(state, sighting, params)
    glance = _Glance(sighting, view, heard, seconds)
    first = state.belief.pose.shape[0] == 0
    if first:
        if assets.initial.kind != "pose" and view.points.shape[1] == 0 and view.detections is None:
            return state._replace(last=sighting), None
        if assets.initial.heading is not None:
            yaw, sd = assets.initial.heading
            heard = Heard(yaw + sighting.odometry[2] - state.begun_yaw_rad, sd, 1.0)
        rng = draw(Purpose.INIT, sighting.stamp_ns)
        state = state._replace(belief=start_on_field.scatter(view, heard, assets, params, rng))
    else:
        state, glance = _move(state, glance, assets, params, draw)
    belief = state.belief._replace(log_w=state.belief.log_w - normalize(state.belief.log_w)[1])
    state = state._replace(belief=weigh(belief, view, heard, assets, params))
    if params.variant == "corrected" and view.best > 0.0:
        state, glance = _look_around_if_lost(state, glance, first, assets, params, draw)
    if view.seen is not None:
        belief = state.belief
        missed = of_missed(belief.pose, view, assets, params)
        state = state._replace(belief=belief._replace(log_w=belief.log_w + missed))
    return _conclude(state, glance, assets, params, draw)


def _move(state: State, glance: _Glance, assets: Assets, params: Params, draw: Draw) -> tuple[State, _Glance]:
    """Particles after the step since the last frame, and new ones where the lines want them."""
    moved = between(np.array([state.last.odometry]), np.array([glance.sighting.odometry]))[0]
    rng = draw(Purpose.MOTION, glance.sighting.stamp_ns)
    belief, slip = _predict(state, glance.sighting, moved, params, rng)
    state = state._replace(belief=belief, way_m=state.way_m + float(np.hypot(moved[0], moved[1])))
    if params.variant == "paper":
        return state, glance._replace(slip_m=slip)
    count = round(params.refine * params.particles)
    at = compose(state.pose[None], moved[None])[0]
    belief, surprise = line_proposal.beside(state.belief, at, glance.view, assets, count, rng)
    refined = belief.pose.shape[0] - state.belief.pose.shape[0]
    stretch = _stretched(state.stretch, surprise) if params.adapt else 1.0
    glance = glance._replace(slip_m=slip, surprise=surprise, refined=refined)
    return state._replace(belief=belief, stretch=stretch), glance


def _look_around_if_lost(
    state: State, glance: _Glance, first: bool, assets: Assets, params: Params, draw: Draw
) -> tuple[State, _Glance]:
    """Where the last frames fit badly, the particles get company of those of a robot that may be anywhere: each side by its
    prior and its evidence."""
    stamp_ns, belief = glance.sighting.stamp_ns, state.belief
    now, best = normalize(belief.log_w)[1], glance.view.best
    if not first:
        now, best = (old + _FADING * (new - old) for old, new in zip(state.fit, (now, best), strict=True))
    rested = not state.injected_ns or stamp_ns - state.injected_ns[-1] >= _REST_NS
    if first or now >= params.lost_fit * best or not rested or not line_proposal.tells(glance.view):
        return state._replace(fit=(now, best)), glance
    # what held at the start need not hold now
    rng = draw(Purpose.INJECT, stamp_ns)
    found = start_on_field.anywhere(glance.view, glance.heard, assets, params, params.particles, rng)
    found = weigh(found, glance.view, glance.heard, assets, params)
    state.injected_ns.append(stamp_ns)
    both = Belief(
        np.concatenate([belief.pose, found.pose]),
        np.concatenate([belief.log_w + np.log(1.0 - params.lost_share), found.log_w + np.log(params.lost_share)]),
        np.concatenate([belief.odds, found.odds]),
    )
    return state._replace(belief=both, fit=(best, best)), glance._replace(injected=found.pose.shape[0])


def _stretched(stretch: float, surprise: float) -> float:
    """The motion's variance in units of its parameters: grows with frames that surprise, fades to 1 with others."""
    return min(max(stretch * (1.0 + _ADAPT * (min(surprise, _WILD) - 1.0)), 1.0), 1e4)


def _heard(state: State, sighting: Sighting, params: Params) -> Heard | None:
    """The compass in the field's frame, its bias removed; readings of one memory count as one."""
    if sighting.compass is None or not params.compass:
        return None
    yaw = sighting.compass.yaw_rad + math.radians(params.compass_north_deg - 90.0) - state.bias.mean_rad
    own = sighting.compass.sigma_rad
    sigma = own if math.isfinite(own) and own > 0.0 else math.radians(params.compass_sigma_deg)
    if state.heard_ns == 0 or params.variant == "paper" or params.compass_memory_s == 0.0:
        return Heard(yaw, sigma, 1.0)
    seconds = (sighting.stamp_ns - state.heard_ns) * 1e-9
    return Heard(yaw, sigma, min(1.0, seconds / params.compass_memory_s))


def _predict(
    state: State, sighting: Sighting, moved: NDArray[np.float64], params: Params, rng: np.random.Generator
) -> tuple[Belief, float]:
    """Particles after the step `moved` since the last frame, and the largest slip of a wheel (m)."""
    belief, now, last = state.belief, sighting.rolling, state.last.rolling
    if now is None or last is None or now.rolled_m.shape != last.rolled_m.shape:
        z = rng.standard_normal(belief.pose.shape)
        sd = math.sqrt(state.stretch) * step_noise(moved, params)
        return belief._replace(pose=odometry.predict(belief.pose, moved, sd, z)), 0.0
    mean, sd, residual = _wheel_errors(now, last, params)
    sd = math.sqrt(state.stretch) * sd
    z = rng.standard_normal((belief.pose.shape[0], sd.size))
    pose = wheels.predict(belief.pose, wheels.midway(moved), now.back, mean, sd, z)
    return belief._replace(pose=pose), float(np.abs(residual).max())


def _wheel_errors(
    now: Rolling, last: Rolling, params: Params
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mean and spread (k,) of each wheel's error in this step, and the travel that no motion explains (m)."""
    travel, way = now.rolled_m - last.rolled_m
    residual = wheels.slip(travel, now.jacobian, now.back)
    sd = params.wheel_noise * way + params.wheel_noise_m + params.slip_gain * np.abs(residual)
    return params.wheel_bias * travel, sd, residual


def _conclude(state: State, glance: _Glance, assets: Assets, params: Params, draw: Draw) -> tuple[State, Info]:
    """Report, learn the compass, then resample."""
    sighting, view, heard = glance.sighting, glance.view, glance.heard
    weights, log_evidence = normalize(state.belief.log_w)
    # sides that are equally likely: the one that was shown, at first the one that the compass is nearer to
    shown = heard.yaw_rad if heard is not None else state.belief.pose[int(np.argmax(weights)), 2]
    if state.track.updates:
        shown = state.pose[2] + sighting.odometry[2] - state.last.odometry[2]
    forgotten = params.side_fade_per_s * glance.seconds
    belief, mirror_p = choose_side(state.belief, float(shown), weights, forgotten, glance.surprise > _WILD)
    pose = belief.pose
    found = estimate.densest(pose, weights, line_proposal.MODE_M, line_proposal.MODE_RAD)
    if params.estimate == "best" or params.variant == "paper":
        found = found._replace(pose=pose[int(np.argmax(weights))].copy())
    sd_m, sd_yaw = float(np.sqrt(found.cov[0, 0] + found.cov[1, 1])), float(np.sqrt(found.cov[2, 2]))
    state.track.update(found.pose, found.cov)
    state.mirror_p.append(mirror_p)
    if found.mass >= _CERTAIN and sd_m <= _CERTAIN_M and mirror_p < 0.5 * (1.0 - _CERTAIN):
        state.certain_ns.append(sighting.stamp_ns)
    bias, residual = _learned(state, glance, found, sd_yaw, params)
    two = landmarks.triangulated(view.detections, found.pose) if view.detections is not None else None
    two = two or (math.nan, math.nan, math.nan)
    n_eff = float(effective_sample_size(weights))
    crowded = pose.shape[0] > params.particles
    resample = params.variant == "paper" or crowded or n_eff < params.resample_threshold * pose.shape[0]
    state.frames.offer(sighting.stamp_ns, found.pose, pose, view.points.T)
    info = Info(
        t_ns=sighting.stamp_ns,
        best_log_w=float(belief.log_w.max()),
        mode_share=found.mass,
        modes=estimate.modes(pose, weights, line_proposal.MODE_M, line_proposal.MODE_RAD),
        mirror_p=mirror_p,
        sd_m=sd_m,
        sd_yaw_rad=sd_yaw,
        n_eff=n_eff,
        log_evidence=log_evidence,
        fit=state.fit[0] / state.fit[1],
        points=view.points.shape[1],
        landmarks=0 if view.detections is None else view.detections.seen_m.shape[0],
        compass_residual_rad=residual,
        compass_bias_rad=bias.mean_rad,
        compass_disturbed=heard is not None and compass.is_bent(state.bias, residual, heard.sigma_rad),
        slip_m=glance.slip_m,
        injected=glance.injected,
        refined=glance.refined,
        resampled=bool(resample),
        way_m=state.way_m,
        two_x_m=two[0],
        two_y_m=two[1],
        two_yaw_rad=two[2],
    )
    heard_ns = sighting.stamp_ns if heard is not None else state.heard_ns
    state = state._replace(pose=found.pose, bias=bias, heard_ns=heard_ns, last=sighting)
    if not resample:
        return state._replace(belief=belief._replace(log_w=belief.log_w - log_evidence)), info
    rng = draw(Purpose.RESAMPLE, sighting.stamp_ns)
    if params.variant == "paper":
        chosen = multinomial.ancestors(weights, rng.random(params.particles))
    else:
        chosen = systematic.choose(weights, rng.random(), params.particles)
    n = chosen.size
    fresh = pose[chosen]
    if params.variant == "paper" and params.new_share > 0.0:
        new = round(params.new_share * n)
        fresh[:new] = start_on_field.anyhow(new, None, assets, folded=False, rng=rng)
    return state._replace(belief=Belief(fresh, np.full(n, -np.log(n)), belief.odds[chosen])), info


def _learned(
    state: State, glance: _Glance, found: estimate.PoseEstimate, sd_yaw: float, params: Params
) -> tuple[compass.Bias, float]:
    """The bias after this reading, which a filter that is sure of its heading teaches; and what the reading differs by."""
    heard = glance.heard
    if heard is None:
        return state.bias, math.nan
    residual = math.remainder(heard.yaw_rad - float(found.pose[2]), 2 * math.pi)
    if not params.compass_bias or sd_yaw > _LEARN_SD_RAD or found.mass < _CERTAIN:
        return state.bias, residual
    seconds = (glance.sighting.stamp_ns - state.heard_ns) * 1e-9 if state.heard_ns else params.compass_memory_s
    return compass.learn(state.bias, residual, heard.sigma_rad, seconds, params.compass_memory_s), residual


def finish(state: State, assets: Assets, params: Params) -> Result:
    """Track, the other side of it, and the field."""
    track = state.track.track({"mirror_p": np.array(state.mirror_p)})
    other = turned(track.poses)
    columns = track.columns | dict(zip(("mirror_x_m", "mirror_y_m", "mirror_yaw_rad"), other.T, strict=True))
    since = (state.certain_ns[0] - int(track.stamps_ns[0])) * 1e-9 if state.certain_ns else None
    summary = {
        "updates": int(track.columns["update"].sum()),
        "certain_since_s": None if since is None else round(since, 3),
        "injections": len(state.injected_ns),
        "mirror_p_at_end": round(state.mirror_p[-1], 4),
        "compass_bias_deg": round(math.degrees(state.bias.mean_rad), 2),
        "particles": int(state.belief.pose.shape[0]),
    }
    field = field_yaml.drawn(assets.field, assets.table)
    return Result(track._replace(columns=columns), field, state.frames.frames(), summary, given_frame=True)


FILTER = Filter(info=Info, load=load, init=init, step=step, finish=finish)
