"""Algorithm 1 of Zhang 2010, line by line (`--variant paper`); only the misprint of eq. (10) is mended.

Its faults are kept: p(z) counts twice in classes 3 and 6 and three times in class 2 (lines 4, 51 and eqs (21)-(23)),
p12 is a constant per update, and no scan can move weight between the inside and the outside.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core.resample import systematic
from pfcli.core.sensor import likelihood_field
from pfcli.rng import Draw, Purpose
from pfcli.systems.localize_partial import cluster_kernels
from pfcli.systems.localize_partial.class_belief import Belief, Reading
from pfcli.systems.localize_partial.incomplete_map import Assets, band_count
from pfcli.systems.localize_partial.params import Params
from pfcli.systems.shared.motion_gate import step_noise


def update(belief: Belief, reading: Reading, assets: Assets, params: Params, draw: Draw) -> Belief:
    """One call of algorithm 1; the numbers in the comments are its lines."""
    pose, label, b = belief.pose, belief.label, belief.b
    moved, stamp_ns = reading.moved, reading.stamp_ns
    transition = np.zeros((7, 7))
    region = assets.region
    fresh = np.empty((0, 3))
    predicted = b.copy()
    if not reading.first:
        sd = step_noise(moved, params)
        count = band_count(region, moved, sd)
        if count:  # 2-5
            u = draw(Purpose.INJECT, stamp_ns).random((params.frontier_samples, 4))
            fresh = cluster_kernels.entries(
                region.edge_xy, count, region.resolution_m, moved, u, region.place, region.frame, False
            )
        drawn = _drawn(belief, params, draw(Purpose.RESAMPLE, stamp_ns))  # 9
        z = draw(Purpose.MOTION, stamp_ns).standard_normal((drawn.size, 3))
        before = label[drawn]
        pose, label, _ = cluster_kernels.move(pose[drawn], before, moved, sd, z, region)  # 10-44
        sizes = np.bincount(before, minlength=7)
        weight = 1.0 / sizes[before] * b[before]
        transition = cluster_kernels.flow(before, label, weight)
        p12 = params.p12 if fresh.size else 0.0
        transition[1, 1], transition[1, 2] = b[1] * (1 - p12), b[1] * p12  # 45
        predicted = transition.sum(axis=0)  # 46-50
    else:
        weight = belief.weight
    likelihood = _likelihood(np.concatenate([fresh, pose]), reading.ends, assets, params)
    m = fresh.shape[0]
    pose, label = np.concatenate([fresh, pose]), np.concatenate([np.full(m, 2, np.uint8), label])
    weight = np.concatenate([likelihood[:m] * likelihood[:m], weight])  # 4 and 51
    seen = (label == 3) | (label == 6)
    weight[seen] *= likelihood[seen]  # 52, 53
    after, alpha = predicted.copy(), np.zeros(7)
    for k in range(2, 7):
        of = label == k
        total = weight[of].sum()
        if total > 0.0:
            weight[of] /= total  # 54
            alpha[k] = predicted[k] * (weight[of] @ likelihood[of])  # (21)-(23)
    inside = predicted[2] + predicted[3] + predicted[6]
    whole = alpha[2] + alpha[3] + alpha[6]
    if whole > 0.0:
        for k in (2, 3, 6):
            after[k] = alpha[k] * inside / whole  # (16), (17), (20)
    after /= after.sum()
    n_eff = float(1.0 / np.square(weight[label == 3]).sum()) if (label == 3).any() else 0.0
    found: Any = belief._replace(pose=pose, label=label, weight=weight * after[label], b=after, transition=transition)
    return found._replace(n_eff=n_eff)  # type: ignore[no-any-return]


def _drawn(belief: Belief, params: Params, rng: np.random.Generator) -> NDArray[np.int64]:
    """Line 9, for all clusters: N_k members by weight, N_k the cluster's size but at most `particles`."""
    chosen = []
    for k in range(2, 7):
        members = np.flatnonzero(belief.label == k)
        weights = belief.weight[members]
        if members.size and weights.sum() > 0.0:
            n = min(members.size, max(params.particles, 1))
            chosen.append(members[systematic.choose(weights, rng.random(), n)])
    return np.concatenate(chosen) if chosen else np.empty(0, np.int64)


def _likelihood(
    pose: NDArray[np.float64], ends: NDArray[np.float32], assets: Assets, params: Params
) -> NDArray[np.float64]:
    """p(z | x) up to a common factor."""
    log = params.beam_gain * likelihood_field.evidence(pose, ends, assets.field)
    found: NDArray[np.float64] = np.exp(log - log.max(initial=-np.inf)) if log.size else log
    return found
