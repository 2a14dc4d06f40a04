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
from pfcli.core.resample import multinomial, systematic
from pfcli.core.sensor import compass, known_landmarks
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.events import Sighting
from pfcli.rng import Draw, Purpose
from pfcli.systems.fuse_soccer import line_proposal, start_on_field
from pfcli.systems.fuse_soccer.compass_reading import CERTAIN, heard_of, learned
from pfcli.systems.fuse_soccer.field_assets import Assets, load, view_of
from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.fuse_soccer.sighting_likelihood import Belief, Heard, choose_side, of_missed, weigh
from pfcli.systems.fuse_soccer.soccer_result import finish
from pfcli.systems.fuse_soccer.soccer_state import Glance, State, init
from pfcli.systems.fuse_soccer.wheel_motion import WILD, rolled, stretched
from pfcli.systems.shared.contract import Filter

_CERTAIN_M = 0.3
"""A track is certain from the first frame whose spread is below this."""
_FADING = 0.2
"""Weight of the newest frame in `fit`: one bad frame is no reason to think oneself lost."""
_REST_NS = 500_000_000
"""Who is still lost looks around again after this time."""


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


def step(state: State, sighting: Sighting, assets: Assets, params: Params, draw: Draw) -> tuple[State, Info | None]:
    """Every frame updates the filter, once there was something to start from."""
    state.track.see(sighting)
    view = view_of(sighting, assets, params)
    seconds = (sighting.stamp_ns - state.last.stamp_ns) * 1e-9
    heard = heard_of(state, sighting, params)
    glance = Glance(sighting, view, heard, seconds)
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


def _move(state: State, glance: Glance, assets: Assets, params: Params, draw: Draw) -> tuple[State, Glance]:
    """Particles after the step since the last frame, and new ones where the lines want them."""
    moved = between(np.array([state.last.odometry]), np.array([glance.sighting.odometry]))[0]
    rng = draw(Purpose.MOTION, glance.sighting.stamp_ns)
    belief, slip = rolled(state, glance.sighting, moved, params, rng)
    state = state._replace(belief=belief, way_m=state.way_m + float(np.hypot(moved[0], moved[1])))
    if params.variant == "paper":
        return state, glance._replace(slip_m=slip)
    count = round(params.refine * params.particles)
    at = compose(state.pose[None], moved[None])[0]
    belief, surprise = line_proposal.beside(state.belief, at, glance.view, assets, count, rng)
    refined = belief.pose.shape[0] - state.belief.pose.shape[0]
    stretch = stretched(state.stretch, surprise) if params.adapt else 1.0
    glance = glance._replace(slip_m=slip, surprise=surprise, refined=refined)
    return state._replace(belief=belief, stretch=stretch), glance


def _look_around_if_lost(
    state: State, glance: Glance, first: bool, assets: Assets, params: Params, draw: Draw
) -> tuple[State, Glance]:
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


def _conclude(state: State, glance: Glance, assets: Assets, params: Params, draw: Draw) -> tuple[State, Info]:
    """Report, learn the compass, then resample."""
    sighting, view, heard = glance.sighting, glance.view, glance.heard
    weights, log_evidence = normalize(state.belief.log_w)
    # sides that are equally likely: the one that was shown, at first the one that the compass is nearer to
    shown = heard.yaw_rad if heard is not None else state.belief.pose[int(np.argmax(weights)), 2]
    if state.track.updates:
        shown = state.pose[2] + sighting.odometry[2] - state.last.odometry[2]
    forgotten = params.side_fade_per_s * glance.seconds
    belief, mirror_p = choose_side(state.belief, float(shown), weights, forgotten, glance.surprise > WILD)
    pose = belief.pose
    found = estimate.densest(pose, weights, line_proposal.MODE_M, line_proposal.MODE_RAD)
    if params.estimate == "best" or params.variant == "paper":
        found = found._replace(pose=pose[int(np.argmax(weights))].copy())
    sd_m, sd_yaw = float(np.sqrt(found.cov[0, 0] + found.cov[1, 1])), float(np.sqrt(found.cov[2, 2]))
    state.track.update(found.pose, found.cov)
    state.mirror_p.append(mirror_p)
    if found.mass >= CERTAIN and sd_m <= _CERTAIN_M and mirror_p < 0.5 * (1.0 - CERTAIN):
        state.certain_ns.append(sighting.stamp_ns)
    bias, residual = learned(state, glance, found, sd_yaw, params)
    two = known_landmarks.triangulated(view.detections, found.pose) if view.detections is not None else None
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
    return state._replace(belief=_resampled(belief, weights, sighting.stamp_ns, assets, params, draw)), info


def _resampled(
    belief: Belief, weights: NDArray[np.float64], stamp_ns: int, assets: Assets, params: Params, draw: Draw
) -> Belief:
    """`params.particles` particles of equal weight; in the paper's variant a share of them is new."""
    rng, paper = draw(Purpose.RESAMPLE, stamp_ns), params.variant == "paper"
    if paper:
        chosen = multinomial.ancestors(weights, rng.random(params.particles))
    else:
        chosen = systematic.choose(weights, rng.random(), params.particles)
    n = chosen.size
    pose = belief.pose[chosen]
    if paper and params.new_share > 0.0:
        new = round(params.new_share * n)
        pose[:new] = start_on_field.anyhow(new, None, assets, folded=False, rng=rng)
    return Belief(pose, np.full(n, -np.log(n)), belief.odds[chosen])


FILTER = Filter(info=Info, load=load, init=init, step=step, finish=finish)
