"""Poses drawn blindly, gathered where a scan fits: a likelihood that narrows step by step (an SMC sampler, Del Moral 2006).

A pose off by 0.2 m explains distant walls as badly as any other; among a thousand blind ones none may be near enough.
"""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.resample import systematic
from pfcli.core.sensor import likelihood_field
from pfcli.systems.localize_partial.class_belief import Reading
from pfcli.systems.localize_partial.incomplete_map import Assets
from pfcli.systems.localize_partial.params import Params

_MOST_LOG = 700.0
_ARM_M = 5.0
"""Distance at which a jitter of the heading moves an end point as far as that of the position."""


def gather(
    poses: NDArray[np.float64],
    mass: float,
    keep: int,
    reading: Reading,
    assets: Assets,
    params: Params,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Resample blind poses (n, 3), which hold `mass` together, through ever narrower likelihoods.

    Returns at most `keep` poses and their weights, such that weight x likelihood is what the blind ones stand for.
    """
    weight = np.full(poses.shape[0], mass / poses.shape[0])
    before = np.zeros(poses.shape[0])
    for wider in (2, 1):
        level = np.minimum(reading.level + wider, likelihood_field.LEVELS - 1).astype(np.int32)
        base = _blurred(reading, level, assets)
        log = params.beam_gain * likelihood_field.evidence(poses, reading.ends, assets.field, level, base)
        weight = weight * np.exp(np.minimum(log - before, _MOST_LOG))
        total = weight.sum()
        poses = poses[systematic.choose(weight, rng.random(), min(keep, poses.shape[0]))]
        weight = np.full(poses.shape[0], total / poses.shape[0])
        sigma = params.sigma_hit_m * 2**wider
        spread = np.array([sigma, sigma, sigma / _ARM_M]) / 4
        poses = poses + spread * rng.standard_normal(poses.shape)
        before = params.beam_gain * likelihood_field.evidence(poses, reading.ends, assets.field, level, base)
    return poses, weight * np.exp(np.minimum(-before, _MOST_LOG))


def _blurred(reading: Reading, level: NDArray[np.int32], assets: Assets) -> NDArray[np.float32]:
    """What the last metres explain, blurred as the map is: else no wide match could better it, and misses would win."""
    lost = assets.field.top[reading.level] - assets.field.top[level]
    return np.where(reading.base > 0.0, np.maximum(0.0, reading.base - lost), reading.base).astype(np.float32)
