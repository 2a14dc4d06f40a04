"""One update with the misprints of algorithm 1 mended (`--variant corrected`), and the outside competing for the scan.

In the paper's order: particles move and change class (section 2), those who may have come in are drawn at the frontiers
(definition 1), the scan weighs particles and classes (eqs (13)-(23)), each cluster is resampled on its own.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import particles
from pfcli.core.resample import systematic
from pfcli.core.sensor import likelihood_field
from pfcli.core.weights import effective_sample_size
from pfcli.rng import Draw, Purpose
from pfcli.systems.localize_partial import anneal, kernels
from pfcli.systems.localize_partial.belief import Assets, Belief, Reading, band_count, in_the_map
from pfcli.systems.localize_partial.params import Params
from pfcli.systems.pace import step_noise

_BIN_M, _BIN_RAD = 0.5, 0.26
_NEGLIGIBLE = 1e-9
_WORTH_A_SEARCH = 3e-4
"""Mass of class 1 from which it is asked where it may have come in: surprises raise it in a few scans."""
_BLIND = 3
"""Blind poses, anywhere in the map, for each that is gathered: too few of them miss the place. As many are kept of
classes 2 and 3 that hold next to no mass."""
_BACK = 1e-7
"""Mass of class 6 from which it is gathered."""
_GIVEN_UP = 1e-3
"""A class of less mass has been left for long: no slip of this step explains that."""
_ASKED, _SETTLED_M, _SETTLED_SHARE = 64, 0.5, 0.9
"""Particles of class 3 that are asked together, and what share of them must lie how near to each other."""
_MARGIN_LEFT = 0.5
"""Share of the history's margin that is granted then: the other half stood for the spread."""
_MOST_AGAINST = 1.0
"""Log evidence that a single scan may hold against the whole map: one glance at a crowd is no proof that the robot has left."""


class Cloud(NamedTuple):
    """pose (n, 3), class (n,) and weight (n,) of particles; log_ratio (n,), log likelihood of the scan over that outside."""

    pose: NDArray[np.float64]
    label: NDArray[np.uint8]
    weight: NDArray[np.float64]
    log_ratio: NDArray[np.float64]


def update(belief: Belief, reading: Reading, assets: Assets, params: Params, draw: Draw) -> Belief:
    """Predict, enter, weigh, regroup."""
    moved, stamp_ns = reading.moved, reading.stamp_ns
    pose, label, weight = belief.pose, belief.label, belief.weight
    transition = np.zeros((7, 7))
    b1 = float(belief.b[1])
    if not reading.first:
        before = label
        z = draw(Purpose.MOTION, stamp_ns).standard_normal((pose.shape[0], 3))
        pose, label, factor = kernels.move(pose, label, moved, step_noise(moved, params), z, assets.region)
        transition = kernels.flow(before, label, weight)
        weight = weight * factor
        pose, label, weight = _come_back(pose, label, weight, reading, assets, params, draw)
        pose, label, weight, b1 = _arrive(pose, label, weight, b1, reading, transition, assets, params, draw)
    elif assets.initial.kind != "pose" and pose.shape[0]:
        rng = draw(Purpose.INJECT, stamp_ns)
        pose, weight = anneal.gather(pose, float(weight.sum()), params.particles, reading, assets, params, rng)
        label = np.full(pose.shape[0], 3, np.uint8)
    predicted = kernels.masses(label, weight)
    predicted[1] = b1
    cloud = Cloud(pose, label, weight, _log_ratios(pose, label, reading, assets, params))
    settled = _settled(cloud, reading, assets, params, draw)
    if not reading.first and (settled is None or settled < 0.0):
        cloud = _look_around(cloud, reading, assets, params, draw)
        settled = _settled(cloud, reading, assets, params, draw)
    pose, label = cloud.pose, cloud.label
    weight, b1, log_evidence = _weigh(cloud, b1, settled, params)
    held = float(weight.sum())
    n_eff = float(effective_sample_size(weight / held)) if held > 0.0 else 0.0
    error = params.kld_error if params.kld else 0.0
    u = draw(Purpose.RESAMPLE, stamp_ns).random(7)
    lost = min(max(params.min_particles, _BLIND * params.frontier_samples), params.particles)
    limits = (params.min_particles, lost, params.particles, params.resample_threshold, error)
    pose, label, weight = kernels.regroup(pose, label, weight, u, *limits, _BIN_M, _BIN_RAD, _NEGLIGIBLE)
    total = weight.sum() + b1
    weight = weight / total
    b = kernels.masses(label, weight)
    b[1] = b1 / total
    return Belief(pose, label, weight, b, transition, predicted, log_evidence, n_eff)


def _come_back(
    pose: NDArray[np.float64],
    label: NDArray[np.uint8],
    weight: NDArray[np.float64],
    reading: Reading,
    assets: Assets,
    params: Params,
    draw: Draw,
) -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.float64]]:
    """Class 6 after a long way outside is spread over metres: gather it where the scan fits."""
    back = label == 6
    mass = float(weight[back].sum())
    if mass <= _BACK:
        return pose, label, weight
    rng = draw(Purpose.INJECT, reading.stamp_ns)
    wanted = max(int(back.sum()), kernels.worth(mass, params.frontier_samples, params.min_particles))
    blind = pose[back][systematic.choose(weight[back], rng.random(), wanted)]
    found, gathered = anneal.gather(blind, mass, blind.shape[0], reading, assets, params, rng)
    return (
        np.concatenate([pose[~back], found]),
        np.concatenate([label[~back], np.full(found.shape[0], 6, np.uint8)]),
        np.concatenate([weight[~back], gathered]),
    )


def _arrive(
    pose: NDArray[np.float64],
    label: NDArray[np.uint8],
    weight: NDArray[np.float64],
    b1: float,
    reading: Reading,
    transition: NDArray[np.float64],
    assets: Assets,
    params: Params,
    draw: Draw,
) -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.float64], float]:
    """Class 1 gives to class 2 at the frontiers (eqs (2)-(3)), and a little to anywhere: a robot may be carried."""
    moved = reading.moved
    way = float(np.hypot(moved[0], moved[1]))
    carried = 1.0 - float(np.exp(-params.kidnap_per_m * way))
    lost = carried * float(weight.sum())
    weight = weight * (1.0 - carried)
    rows = transition.sum(axis=1)
    transition *= 1.0 - carried
    transition[:, 1] += carried * rows
    if b1 <= _WORTH_A_SEARCH:
        transition[1, 1] += b1
        return pose, label, weight, b1 + lost
    entering = b1 * (1.0 - float(np.exp(-way / params.entry_length_m)))
    fresh = []
    region, rng = assets.region, draw(Purpose.INJECT, reading.stamp_ns)
    wanted = kernels.worth(b1, params.frontier_samples, params.min_particles)
    count = band_count(region, moved, step_noise(moved, params)) if entering > 0.0 else 0
    if count:
        u = rng.random((2 * wanted, 4))
        found = kernels.entries(region.edge_xy, count, region.resolution_m, moved, u, region.place, region.frame, True)
        fresh.append((2, entering, found[:wanted]))
    if carried > 0.0:
        blind = particles.uniform(region.free_xy, region.resolution_m / 2, _BLIND * wanted, rng)
        fresh.append((3, b1 * carried, blind))
    left = b1
    for k, mass, poses in fresh:
        if poses.shape[0] == 0:
            continue
        poses, gathered = anneal.gather(poses, mass, wanted, reading, assets, params, rng)
        m = poses.shape[0]
        pose, label = np.concatenate([pose, poses]), np.concatenate([label, np.full(m, k, np.uint8)])
        weight = np.concatenate([weight, gathered])
        transition[1, k] += mass
        left -= mass
    transition[1, 1] += left
    return pose, label, weight, left + lost


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


def _look_around(cloud: Cloud, reading: Reading, assets: Assets, params: Params, draw: Draw) -> Cloud:
    """Where the scan speaks for the outside, the odometry may have slipped instead: gather class 3 in a wider circle."""
    pose, label, weight, log_ratio = cloud
    here = label == 3
    mass = float(weight[here].sum())
    if params.slip == 0.0 or mass <= _GIVEN_UP or float(weight[here] @ np.exp(log_ratio[here])) >= mass:
        return cloud
    rng = draw(Purpose.SLIP, reading.stamp_ns)
    blind = pose[here][systematic.choose(weight[here], rng.random(), params.frontier_samples)]
    blind = blind + np.array([params.slip_xy_m, params.slip_xy_m, params.slip_yaw_rad]) * rng.standard_normal(
        blind.shape
    )
    found, gathered = anneal.gather(blind, params.slip * mass, blind.shape[0], reading, assets, params, rng)
    threes = np.full(found.shape[0], 3, np.uint8)
    return Cloud(
        np.concatenate([pose, found]),
        np.concatenate([label, threes]),
        np.concatenate([np.where(here, (1.0 - params.slip) * weight, weight), gathered]),
        np.concatenate([log_ratio, _log_ratios(found, threes, reading, assets, params)]),
    )


def _settled(cloud: Cloud, reading: Reading, assets: Assets, params: Params, draw: Draw) -> float | None:
    """Log evidence of class 3 as a whole once it knows where it is; None while it does not.

    The last metres are asked at one pose, the map at many: a cluster would pay for every turn that spreads it, and for
    what both know the outside would win. Settled, it is asked where it is after the scan, and a beam that map and last
    metres both explain speaks for nobody.
    """
    pose, label, weight, log_ratio = cloud
    if not params.outside_likelihood or reading.first:
        return None
    here, after = kernels.after_scan(label, 3, weight, log_ratio)
    if after.sum() <= 0.0:
        return None
    u = float(draw(Purpose.SETTLED, reading.stamp_ns).random())
    some = pose[here[systematic.choose(after, u, _ASKED)]]
    if kernels.together(some, _SETTLED_M) < _SETTLED_SHARE:
        return None
    base = reading.base.copy()
    base[0, base[0] > 0.0] += (1.0 - _MARGIN_LEFT) * params.history_margin
    evidence = likelihood_field.evidence(some, reading.ends, assets.field, reading.level, base, least=0.0)
    return params.beam_gain * float(evidence.mean())


def _weigh(cloud: Cloud, b1: float, settled: float | None, params: Params) -> tuple[NDArray[np.float64], float, float]:
    """Eqs (13)-(23) with the likelihood counted once; it is a ratio to the outside, which the outside classes take as 1."""
    _, label, weight, log_ratio = cloud
    least = -np.inf if settled is None else settled
    after, sum_after, top, before, left = kernels.weigh(label, weight, log_ratio, least, _MOST_AGAINST)
    if params.outside_likelihood:
        b1 = b1 * float(np.exp(-top))
        total = sum_after + b1
        return after / total, b1 / total, top + float(np.log(total))
    if left <= 0.0:
        return weight, b1, 0.0
    return np.where(in_the_map(label), after * (before / left), weight), b1, top + float(np.log(left / before))
