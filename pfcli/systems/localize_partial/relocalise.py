"""Mass that no particle stands for, and the particles that come of it (`--variant corrected`).

b[1] is class 1, outside with an unknown pose. b[0] is a robot somewhere in the map, nobody knows where: part of class 3,
but without particles until it is worth a search.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import particles
from pfcli.core.geometry import between, compose
from pfcli.core.resample import systematic
from pfcli.core.sensor import likelihood_field
from pfcli.rng import Draw, Purpose
from pfcli.systems.localize_partial import annealed_sampler, cluster_kernels
from pfcli.systems.localize_partial.class_belief import Reading
from pfcli.systems.localize_partial.incomplete_map import Assets, band_count
from pfcli.systems.localize_partial.params import Params
from pfcli.systems.shared.motion_gate import step_noise

WORTH_A_SEARCH = 3e-4
"""Mass without a pose from which it is asked where it may be: surprises raise it in a few scans."""
BLIND = 3
"""Blind poses anywhere in the map, as a multiple of `frontier_samples`, however little mass is looked for: too few of them miss
the place."""
_GIVEN_UP = 0.1
"""Mass of class 1 from which no place is believed in any more, and all that the last metres say counts for another one. Before
that the map may as well be wrong where the robot is (Wean Hall, 6 m): then places elsewhere fit them better."""
_LOOKED_FOR = 0.1
"""Share of those somewhere in the map that is looked for at each update."""
MISSED = 0.1
"""Share of those in the map at an unknown start whose place the first particles miss."""
_WRONG_LASTS_M = 4.5
"""Mean way for which a wrong place goes on explaining the scans (decision 029)."""
MOST_AGAINST = 1.0
"""Log evidence that a single scan may hold against the whole map: one glance at a crowd is no proof that the robot has left."""
_BACK = 1e-7
"""Mass of class 6 from which it is gathered."""


class Placed(NamedTuple):
    """pose (n, 3), class (n,) and weight (n,) of particles."""

    pose: NDArray[np.float64]
    label: NDArray[np.uint8]
    weight: NDArray[np.float64]


def together(some: Placed, more: Placed) -> Placed:
    """All particles of both."""
    return Placed(
        np.concatenate([some.pose, more.pose]),
        np.concatenate([some.label, more.label]),
        np.concatenate([some.weight, more.weight]),
    )


def lose(
    weight: NDArray[np.float64],
    unplaced: NDArray[np.float64],
    reading: Reading,
    transition: NDArray[np.float64],
    params: Params,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A robot may be carried to anywhere, in the map or out of it: (weights (n,), unplaced (2,)) after that.

    What the last metres foretell is foretold to nobody who was carried just now: where scan follows scan, nearly none was.
    transition: (7, 7), flow of the particles between the classes; that of the others is written into it.
    """
    way = float(np.hypot(reading.moved[0], reading.moved[1]))
    carried = 1.0 - float(np.exp(-params.kidnap_per_m * way))
    unforeseen = float(np.exp(-params.beam_gain * float(reading.base[0].sum())))
    each = carried * unforeseen / 2  # to the inside, and to the outside
    placed = transition.sum(axis=1)
    transition *= 1.0 - carried
    transition[:, :2] = each * placed[:, None]
    # who has lost the way may as well be wrong about being outside
    astray = unplaced[1] * carried / 2
    transition[0, 0], transition[1, 0], transition[1, 1] = unplaced[0], astray, unplaced[1] - astray
    unplaced = unplaced + each * weight.sum() + np.array([astray, -astray])
    return weight * (1.0 - carried), unplaced


def elsewhere(
    threes: NDArray[np.bool_], before: NDArray[np.float64], after: NDArray[np.float64], log_outside: float, way_m: float
) -> float:
    """Log factor of the mass somewhere in the map for a scan, where that of the outside is `log_outside`.

    At the place that nobody has found yet, scans fit as well as where class 3 is taken to be, whose weights (n,) they change:
    that these fit is no evidence against it. But a wrong place does not last, and what was looked for and not found is not there.
    """
    held, left = float(before[threes].sum()), float(after[threes].sum())
    fits = float(np.log(left / held)) if held > 0.0 and left > 0.0 else -np.inf
    return max(log_outside, fits) - way_m / _WRONG_LASTS_M


def search(
    unplaced: NDArray[np.float64],
    reading: Reading,
    transition: NDArray[np.float64],
    assets: Assets,
    params: Params,
    draw: Draw,
) -> tuple[Placed, NDArray[np.float64]]:
    """Where those without a pose may be: class 1 at the frontiers, as class 2 (eqs (2)-(3)), the others anywhere in the map.

    Returns their particles and what is left unplaced (2,); the flow is written into the transition (7, 7).
    """
    rng = draw(Purpose.INJECT, reading.stamp_ns)
    found = Placed(np.empty((0, 3)), np.empty(0, np.uint8), np.empty(0))
    left = unplaced.copy()
    entering = 1.0 - float(np.exp(-np.hypot(reading.moved[0], reading.moved[1]) / params.entry_length_m))
    for source, of_class, share in ((1, 2, entering), (0, 3, _LOOKED_FOR)):
        if unplaced[source] <= WORTH_A_SEARCH or share <= 0.0:
            continue
        given_up = of_class == 3 and unplaced[1] > _GIVEN_UP
        most = params.frontier_samples
        wanted = most if given_up else cluster_kernels.worth(unplaced[source], most, params.min_particles)
        if of_class == 2:
            poses = _at_frontiers(wanted, reading, assets, params, rng)
        else:
            poses = particles.uniform(assets.region.free_xy, assets.region.resolution_m / 2, BLIND * most, rng)
        if poses.shape[0] == 0:
            continue
        mass = share * float(unplaced[source])
        poses, weight = annealed_sampler.gather(poses, mass, wanted, reading, assets, params, rng)
        if not params.outside_likelihood:
            weight *= mass / max(weight.sum(), 1e-300)  # scans may move it within the map only
        elif given_up:
            weight = weight * np.exp(_hindsight(poses, reading, assets, params))
        found = together(found, Placed(poses, np.full(weight.size, of_class, np.uint8), weight))
        transition[:, of_class] += share * transition[:, source]
        transition[:, source] *= 1.0 - share
        left[source] -= mass
    return found, left


def _hindsight(poses: NDArray[np.float64], reading: Reading, assets: Assets, params: Params) -> NDArray[np.float64]:
    """Log likelihood (n,) of the last metres' scans for those who are found only now, and have been in the map all along."""
    total = np.zeros(poses.shape[0])
    for past in reading.past:
        then = compose(poses, between(reading.reckoned[None], past.reckoned[None]))
        log = params.beam_gain * likelihood_field.evidence(then, past.ends, assets.field, past.level, past.base)
        total += np.maximum(log, -MOST_AGAINST) - past.credit
    return total


def _at_frontiers(
    wanted: int, reading: Reading, assets: Assets, params: Params, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Poses (m, 3), m <= wanted, of robots that may just have come in."""
    region, moved = assets.region, reading.moved
    count = band_count(region, moved, step_noise(moved, params))
    if count == 0:
        return np.empty((0, 3))
    u = rng.random((2 * wanted, 4))
    found = cluster_kernels.entries(
        region.edge_xy, count, region.resolution_m, moved, u, region.place, region.frame, True
    )
    return np.asarray(found[:wanted])


def come_back(placed: Placed, reading: Reading, assets: Assets, params: Params, draw: Draw) -> Placed:
    """Class 6 after a long way outside is spread over metres: gather it where the scan fits."""
    pose, label, weight = placed
    back = label == 6
    mass = float(weight[back].sum())
    if mass <= _BACK:
        return placed
    rng = draw(Purpose.INJECT, reading.stamp_ns)
    wanted = max(int(back.sum()), cluster_kernels.worth(mass, params.frontier_samples, params.min_particles))
    blind = pose[back][systematic.choose(weight[back], rng.random(), wanted)]
    found, gathered = annealed_sampler.gather(blind, mass, blind.shape[0], reading, assets, params, rng)
    kept = Placed(pose[~back], label[~back], weight[~back])
    return together(kept, Placed(found, np.full(found.shape[0], 6, np.uint8), gathered))
