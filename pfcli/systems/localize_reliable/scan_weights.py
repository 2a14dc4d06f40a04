"""A scan weighs the particles, those around a scan match, and the global samples. Akai 2023, section 4, eqs (2), (4), (R)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate
from pfcli.core.sensor import class_conditional
from pfcli.core.sensor.class_conditional import Fit, Model, Scan
from pfcli.core.weights import normalize
from pfcli.rng import Draw, Purpose
from pfcli.systems.localize_reliable import global_sampler, key_scans, match_proposal, success_decision
from pfcli.systems.localize_reliable.key_scans import KeyScan
from pfcli.systems.localize_reliable.map_models import Assets
from pfcli.systems.localize_reliable.params import Params
from pfcli.systems.localize_reliable.particle_set import MODE_M, MODE_RAD, Particles, joined
from pfcli.systems.localize_reliable.success_decision import Classifier


class Reading(NamedTuple):
    """One scan: its stamp, the beams that are used, those that are evidence, its key scan and those before it, the measurement
    model and what one beam is worth, and whether global samples are due."""

    stamp_ns: int
    scan: Scan
    counted: Scan
    key: KeyScan
    history: list[KeyScan]
    model: Model
    gain: float
    due: bool


def by_scan(
    particles: Particles, reading: Reading, learnt: Classifier | None, assets: Assets, params: Params, draw: Draw
) -> tuple[Particles, int]:
    """The particles, and where they are due the global samples, after the scan; how many key points matched. The samples are
    the last of the particles."""
    tracked, matches = particles, 0
    if params.match_samples:
        particles = matched(particles, reading, assets, params, draw(Purpose.PROPOSAL, reading.stamp_ns))
    if reading.due:
        particles, matches = sampled(
            particles, tracked, reading, assets, params, draw(Purpose.INJECT, reading.stamp_ns)
        )
    fit = class_conditional.fit(particles.pose, reading.scan, assets.field, reading.model)
    rest = fit
    if reading.counted is not reading.scan:
        rest = class_conditional.fit(particles.pose, reading.counted, assets.field, reading.model)
    between, reliability = judge(rest, particles.reliability, reading.gain, learnt, params)
    within = between + reading.gain * (fit.log_likelihood - rest.log_likelihood)
    log_w = rivalry(particles, within, between, reading.key.worth, params.evidence_top)
    return particles._replace(log_w=log_w, reliability=reliability), matches


def judge(
    fit: Fit, reliability: NDArray[np.float64], gain: float, learnt: Classifier | None, params: Params
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n,) log p(z, d | x) up to a constant, and p(success) after the scan. Akai 2023, eqs (2) and (4).

    d is a function of z, so that weighing by both counts the residuals twice: the decision weighs only if asked to.
    """
    log = gain * fit.log_likelihood
    if learnt is None:
        return log, reliability
    ratio = np.exp(params.decision_gain * success_decision.log_ratio(fit, learnt))
    both = reliability * ratio + (1.0 - reliability)
    top = params.reliability_top
    if params.decision_weighs:
        log = log + np.log(both)
    return log, np.clip(reliability * ratio / both, 1.0 - top, top)


def rivalry(
    particles: Particles, within: NDArray[np.float64], between: NDArray[np.float64], worth: float, top: float
) -> NDArray[np.float64]:
    """(n,) log weights after a scan: within what is believed, and among its rivals, the whole of it counts (within (n,));
    between the two only the beams that are evidence (between (n,)), by the share that the scan is worth beside the key scans,
    and `top` nats at the most: where the map has changed, all beams of a scan err together, and what one scan says is no
    proof."""
    rival, after = ~particles.believed, particles.log_w + within
    if not rival.any() or rival.all():
        return after

    def gained(log: NDArray[np.float64]) -> float:
        of_rivals, of_believed = (
            normalize((particles.log_w + log)[k])[1] - normalize(particles.log_w[k])[1]
            for k in (rival, particles.believed)
        )
        return float(of_rivals - of_believed)

    speaks = gained(between)
    return after + np.where(rival, np.clip(worth * speaks, -top, top) - gained(within), 0.0)


def sampled(
    particles: Particles, tracked: Particles, reading: Reading, assets: Assets, params: Params, rng: np.random.Generator
) -> tuple[Particles, int]:
    """Global samples join; `tracked`: what the tracker predicted. Returns how many key points matched as well."""
    key, history, count = reading.key, reading.history, params.gl_samples
    field, model, gain = assets.field, reading.model, reading.gain
    pose, matches = global_sampler.candidates(history, key, params.gl_steps, assets.features, assets.free_xy, rng)
    pose = global_sampler.gather(pose, global_sampler.STAGES, count, key.scan, field, model, gain, rng)
    # key scans end where the robot may have been carried: since then a robot here has seen what the believed one has
    own = tracked.pose[int(np.argmax(np.where(tracked.believed, tracked.log_w, -np.inf)))]
    past = key_scans.past_evidence(pose, own, history, key, field, model, gain, params.evidence_top)
    prior, area = np.exp(tracked.log_w), assets.free_xy.shape[0] * assets.grid.resolution_m**2
    importance = global_sampler.log_importance(pose, tracked.pose, prior, params.gl_uniform, area, past)
    here = estimate.members(pose, own, MODE_M, MODE_RAD)
    particles = particles._replace(log_w=particles.log_w + global_sampler.halved(particles.pose, pose))
    return joined(particles, Particles(pose, importance - np.log(count), np.full(count, 0.5), here)), matches


def matched(
    particles: Particles, reading: Reading, assets: Assets, params: Params, rng: np.random.Generator
) -> Particles:
    """Particles around the optimum of a scan match join those of the believed place, whose mass they share."""
    own, prior = particles.believed, np.exp(particles.log_w)
    around = match_proposal.gaussian_of(particles.pose[own], prior[own])
    if around.cov[0, 0] + around.cov[1, 1] > MODE_M**2:
        return particles  # not yet one place
    found = match_proposal.match(around, reading.scan, assets.field, reading.model, reading.gain)
    pose, importance = match_proposal.draw(around, found, params.match_samples, params.match_slip, rng)
    mass, count = float(prior[own].sum()), pose.shape[0]
    share = count / (count + own.sum())
    reliability = np.full(count, float(prior[own] @ particles.reliability[own]) / mass)
    particles = particles._replace(log_w=particles.log_w + np.where(own, np.log1p(-share), 0.0))
    return joined(
        particles, Particles(pose, importance + np.log(share * mass / count), reliability, np.ones(count, np.bool_))
    )
