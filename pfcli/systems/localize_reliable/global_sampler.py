"""The global localiser: poses from free-space features of the last scans, and how they join the tracker's particles.

Akai 2023, section 4: samples of p(x | u, z, m) over the last N + 1 scans, weighted by the tracker's prediction, eq. (R).
"""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid import free_space
from pfcli.core.grid.free_space import Features
from pfcli.core.jit import kernel
from pfcli.core.resample import systematic
from pfcli.core.sensor import class_conditional
from pfcli.core.sensor.class_conditional import Field, Model, Scan
from pfcli.core.weights import normalize
from pfcli.systems.localize_reliable import key_scans
from pfcli.systems.localize_reliable.key_scans import KeyScan

_CANDIDATES, _CELL_M, _HALF_M = 4000, 0.05, 6.0
STAGES = ((0.2, 0.1, 0.05), (0.1, 0.04, 0.02))
"""Spread of hits (m) of each narrowing, and the jitter after it (m, rad)."""
_KERNEL_M, _KERNEL_RAD = 0.1, 0.05


def candidates(
    history: list[KeyScan],
    now: KeyScan,
    steps: int,
    known: Features,
    free_xy: NDArray[np.float64],
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], int]:
    """(n, 3) poses where key points of the newest scan and of `steps` key scans before it lie on those of the map; how many
    matches there were. Where the map or the scans have no key point, places are drawn uniformly instead."""
    earlier = [k for k in history if k is not now]
    scans = [*earlier[max(0, len(earlier) - steps) :], now]
    joined = [key_scans.seen_from(now.odometry, k.ends) for k in scans]
    sensors = np.concatenate([key_scans.placed(k.odometry, k.scan.sensor[None]) for k in scans])
    origins = key_scans.seen_from(now.odometry, sensors)
    seen = free_space.local_features(joined, origins, _CELL_M, _HALF_M)
    found = free_space.match(seen, known, _CANDIDATES).pose
    if found.shape[0]:
        return found, found.shape[0]
    xy = free_xy[rng.integers(free_xy.shape[0], size=_CANDIDATES)]
    return np.column_stack([xy, rng.uniform(-np.pi, np.pi, _CANDIDATES)]), 0


def gather(
    poses: NDArray[np.float64],
    stages: tuple[tuple[float, float, float], ...],
    wanted: int,
    scan: Scan,
    field: Field,
    model: Model,
    gain: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """(wanted, 3) of blind poses (n, 3), where the scan fits, through ever narrower likelihoods (Del Moral 2006).

    stages: spread of hits (m) of each, and the jitter after it (m, rad); gain: what one beam is worth.
    """
    before = np.zeros(poses.shape[0])
    for sigma_m, jitter_m, jitter_rad in stages:
        wide = model._replace(sigma_m=sigma_m, by_rays=False)
        log = gain * class_conditional.fit(poses, scan, field, wide).log_likelihood
        weights, _ = normalize(log - before)
        poses = poses[systematic.choose(weights, rng.random(), wanted)]
        poses = poses + np.array([jitter_m, jitter_m, jitter_rad]) * rng.standard_normal(poses.shape)
        before = gain * class_conditional.fit(poses, scan, field, wide).log_likelihood
    return poses


@kernel
def density(at, poses, weights, sd_m, sd_rad):
    """(m,) kernel density (1 / (m^2 rad)) of weighted poses (n, 3) at poses (m, 3)."""
    out = np.zeros(at.shape[0])
    peak = 1.0 / ((2.0 * np.pi) ** 1.5 * sd_m * sd_m * sd_rad)
    for i in range(at.shape[0]):
        for j in range(poses.shape[0]):
            dx, dy = (at[i, 0] - poses[j, 0]) / sd_m, (at[i, 1] - poses[j, 1]) / sd_m
            square = dx * dx + dy * dy
            if square > 16.0:
                continue
            dt = at[i, 2] - poses[j, 2]
            dt = (dt - 2 * np.pi * np.floor((dt + np.pi) / (2 * np.pi))) / sd_rad
            out[i] += weights[j] * peak * np.exp(-0.5 * (square + dt * dt))
    return out


def log_importance(
    samples: NDArray[np.float64],
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    uniform: float,
    area_m2: float,
    past: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(g,) log of prediction over proposal at the global samples: what replaces the motion model in their weight.

    The prediction is a kernel density of the tracker's particles, of which the share `uniform` may be anywhere; the
    proposal is the samples' own density. Where particles and samples stand for the same place each has half of it (`halved`
    for the particles), so that no place gains by being found again. Weights of both sets are then on one scale.
    past: (g,) what the key scans say for each against the believed place; the tracker's weights hold that already.
    """
    tracked = 0.5 * (1.0 - uniform) * density(samples, poses, weights, _KERNEL_M, _KERNEL_RAD)
    anywhere = past + np.log(uniform / (area_m2 * 2 * np.pi))
    predicted = np.logaddexp(np.log(np.maximum(tracked, 1e-300)), anywhere)
    g = samples.shape[0]
    proposal = density(samples, samples, np.full(g, 1.0 / g), _KERNEL_M, _KERNEL_RAD)
    return np.asarray(predicted - np.log(proposal))


def halved(poses: NDArray[np.float64], samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) log of what is left to the tracker's particles (n, 3): half where global samples stand beside them."""
    g = samples.shape[0]
    peak = 1.0 / ((2.0 * np.pi) ** 1.5 * _KERNEL_M**2 * _KERNEL_RAD)
    near = density(poses, samples, np.full(g, 1.0 / g), _KERNEL_M, _KERNEL_RAD)
    return np.where(near > np.exp(-8.0) * peak / g, np.log(0.5), 0.0)  # within four standard deviations of one
