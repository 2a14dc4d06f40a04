"""One update with the misprints of algorithm 1 mended (`--variant corrected`), and the outside competing for the scan.

In the paper's order: particles move and change class (section 2), those who may have come in are drawn at the frontiers
(definition 1), the scan weighs particles and classes (eqs (13)-(23)), each cluster is resampled on its own.
"""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.resample import systematic
from pfcli.core.sensor import likelihood_field
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.rng import Draw, Purpose
from pfcli.systems.localize_partial import annealed_sampler, cluster_kernels
from pfcli.systems.localize_partial.class_belief import Belief, Reading, in_the_map
from pfcli.systems.localize_partial.cluster_resampling import Limits, chooser, regroup
from pfcli.systems.localize_partial.incomplete_map import Assets
from pfcli.systems.localize_partial.params import Params
from pfcli.systems.localize_partial.relocalise import (
    BLIND,
    MOST_AGAINST,
    Placed,
    come_back,
    elsewhere,
    lose,
    search,
    together,
)
from pfcli.systems.localize_partial.unmapped_things import forgiven
from pfcli.systems.shared.motion_gate import step_noise

_BIN_M, _BIN_RAD = 0.5, 0.26
_NEGLIGIBLE = 1e-9
_ASKED, _SETTLED_M, _SETTLED_SHARE = 64, 0.5, 0.9
"""Particles of class 3 that are asked together, and what share of them must lie how near to each other."""
_FINDS_M = 5.0
"""Way in which a robot finds its place after an unknown start."""
_MARGIN_LEFT = 0.5
"""Share of the history's margin that is granted then: the other half stood for the spread."""


def update(belief: Belief, reading: Reading, assets: Assets, params: Params, draw: Draw) -> Belief:
    """Predict, enter, weigh, regroup."""
    moved, stamp_ns = reading.moved, reading.stamp_ns
    pose, label, weight = belief.pose, belief.label, belief.weight
    transition = np.zeros((7, 7))
    unplaced = belief.b[:2]
    if not reading.first:
        before = label
        z = draw(Purpose.MOTION, stamp_ns).standard_normal((pose.shape[0], 3))
        pose, label, factor = cluster_kernels.move(pose, label, moved, step_noise(moved, params), z, assets.region)
        transition = cluster_kernels.flow(before, label, weight)
        placed = come_back(Placed(pose, label, weight * factor), reading, assets, params, draw)
        weight, unplaced = lose(placed.weight, unplaced, reading, transition, params)
        found, unplaced = search(unplaced, reading, transition, assets, params, draw)
        pose, label, weight = together(placed._replace(weight=weight), found)
    elif assets.initial.kind != "pose" and pose.shape[0]:
        rng = draw(Purpose.INJECT, stamp_ns)
        pose, weight = annealed_sampler.gather(
            pose, float(weight.sum()), params.particles, reading, assets, params, rng
        )
        label = np.full(pose.shape[0], 3, np.uint8)
    placed, log_ratio = Placed(pose, label, weight), _log_ratios(pose, label, reading, assets, params)
    settled = _settled(placed, log_ratio, reading, assets, params, draw)
    way_m = float(np.hypot(moved[0], moved[1]))
    weight, unplaced, log_evidence, credit = _weigh(placed, log_ratio, unplaced, settled, way_m, params)
    held = float(weight.sum())
    n_eff = float(effective_sample_size(weight / held)) if held > 0.0 else 0.0
    error = params.kld_error if params.kld else 0.0
    limits = Limits(
        least=params.min_particles,
        lost=min(max(params.min_particles, BLIND * params.frontier_samples), params.particles),
        most=params.particles,
        share=params.resample_threshold,
        error=error,
        side_m=_BIN_M,
        side_rad=_BIN_RAD,
        negligible=_NEGLIGIBLE,
    )
    rng = draw(Purpose.RESAMPLE, stamp_ns)
    placed = placed._replace(weight=weight)
    pose, label, weight = regroup(placed, rng.random(7), limits, chooser(params.resampler, rng))
    total = weight.sum() + unplaced.sum()
    weight = weight / total
    b = cluster_kernels.masses(label, weight)
    b[:2] = unplaced / total
    return Belief(
        pose=pose,
        label=label,
        weight=weight,
        b=b,
        transition=transition,
        log_evidence=log_evidence,
        n_eff=n_eff,
        credit=credit,
    )


def _log_ratios(
    pose: NDArray[np.float64], label: NDArray[np.uint8], reading: Reading, assets: Assets, params: Params
) -> NDArray[np.float64]:
    """Log likelihood of the scan by particle, as a ratio to the outside; 0 for those outside (eqs (13)-(14))."""
    inside = in_the_map(label)
    if inside.all():  # no copies of them
        return params.beam_gain * _evidence(pose, reading, assets)
    log_ratio = np.zeros(label.size)
    if inside.any():
        log_ratio[inside] = params.beam_gain * _evidence(pose[inside], reading, assets)
    return log_ratio


def _evidence(pose: NDArray[np.float64], reading: Reading, assets: Assets) -> NDArray[np.float64]:
    return likelihood_field.evidence(pose, reading.ends, assets.field, reading.level, reading.base)


def _settled(
    placed: Placed, log_ratio: NDArray[np.float64], reading: Reading, assets: Assets, params: Params, draw: Draw
) -> float | None:
    """Log evidence of class 3 as a whole at the least: what a settled one has, or one that is still looking for its place.

    The last metres are asked at one pose, the map at many: a cluster would pay for every turn that spreads it, and for
    what both know the outside would win. Settled, it is asked where it is after the scan, and a beam that map and last
    metres both explain speaks for nobody.
    """
    pose, label, weight = placed
    if not params.outside_likelihood or reading.first:
        return None
    here, after = cluster_kernels.after_scan(label, 3, weight, log_ratio)
    if after.sum() <= 0.0:
        return None
    u = float(draw(Purpose.SETTLED, reading.stamp_ns).random())
    some = pose[here[systematic.choose(after, u, _ASKED)]]
    if cluster_kernels.together(some, _SETTLED_M) < _SETTLED_SHARE:
        looks = reading.way_m < _FINDS_M and assets.initial.kind not in ("pose", "outside")
        return _by_what_is_new(placed, log_ratio, reading, assets, params) if looks else None
    base = reading.base.copy() if reading.things is None else forgiven(reading.base, reading.things, params)
    base[0, base[0] > 0.0] += (1.0 - _MARGIN_LEFT) * params.history_margin
    evidence = likelihood_field.evidence(some, reading.ends, assets.field, reading.level, base, least=0.0)
    return params.beam_gain * float(evidence.mean())


def _by_what_is_new(
    placed: Placed, log_ratio: NDArray[np.float64], reading: Reading, assets: Assets, params: Params
) -> float:
    """Log evidence of class 3 while it is looking for its place: what the last metres foretell tells its places apart, but was no
    news to anybody, inside or outside."""
    here, new = placed.label == 3, reading.base[0] == 0.0
    explained = log_ratio[here]
    if new.any():
        ends, base = np.ascontiguousarray(reading.ends[:, new]), np.ascontiguousarray(reading.base[:, new])
        evidence = likelihood_field.evidence(placed.pose[here], ends, assets.field, reading.level[new], base)
        explained = explained - params.beam_gain * evidence
    log_w = np.log(np.maximum(placed.weight[here], 1e-300))
    return normalize(log_w + log_ratio[here])[1] - normalize(log_w + explained)[1]


def _weigh(
    placed: Placed,
    log_ratio: NDArray[np.float64],
    unplaced: NDArray[np.float64],
    settled: float | None,
    way_m: float,
    params: Params,
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
    """Eqs (13)-(23) with the likelihood counted once; it is a ratio to the outside, which the outside classes take as 1.

    log_ratio: (n,), see `_log_ratios`; unplaced: (2,), see `unplaced`; settled: see `_settled`; way_m: of the step. Returns
    weights (n,), unplaced, log evidence, and the credit of those somewhere in the map (see `Belief`).
    """
    _, label, weight = placed
    least = -np.inf if settled is None else settled
    after, sum_after, top, before, left = cluster_kernels.weigh(label, weight, log_ratio, least, MOST_AGAINST)
    if params.outside_likelihood:
        there = elsewhere(label == 3, weight, after, -top, way_m)
        unplaced = unplaced * np.exp([there, -top])
        total = sum_after + unplaced.sum()
        return after / total, unplaced / total, top + float(np.log(total)), there + top
    if left <= 0.0:
        return weight, unplaced, 0.0, 0.0
    kept = np.where(in_the_map(label), after * (before / left), weight)
    return kept, unplaced, top + float(np.log(left / before)), 0.0
