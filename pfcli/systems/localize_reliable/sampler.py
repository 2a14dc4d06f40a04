"""The global localiser: poses from free-space features of the last scans, and how they join the tracker's particles.

Akai 2023, section 4: samples of p(x | u, z, m) over the last N + 1 scans, weighted by the tracker's prediction, eq. (R).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.grid import free_space
from pfcli.core.grid.free_space import Features
from pfcli.core.jit import kernel
from pfcli.core.resample import systematic
from pfcli.core.sensor import class_conditional
from pfcli.core.sensor.class_conditional import Field, Model, Scan
from pfcli.core.weights import normalize

_CANDIDATES, _CELL_M, _HALF_M = 4000, 0.05, 6.0
_KEY_M, _KEY_RAD = 0.3, 0.5
STAGES = ((0.2, 0.1, 0.05), (0.1, 0.04, 0.02))
"""Spread of hits (m) of each narrowing, and the jitter after it (m, rad)."""
_KERNEL_M, _KERNEL_RAD = 0.1, 0.05


class KeyScan(NamedTuple):
    """odometry (1, 3) where it was taken; sensor (2,) and end points (b, 2) in the base frame (m); scan: the beams of them
    that the filter uses; worth: what it says beyond the key scans before it, as a share of what a scan says."""

    odometry: NDArray[np.float64]
    sensor: NDArray[np.float64]
    ends: NDArray[np.float64]
    scan: Scan
    worth: float


def remember(history: list[KeyScan], scan: KeyScan, most: int) -> None:
    """Keep a scan that is far enough from the last one; at most `most`, in place."""
    if history:
        moved = between(history[-1].odometry, scan.odometry)[0]
        if np.hypot(moved[0], moved[1]) < _KEY_M and abs(moved[2]) < _KEY_RAD:
            return
    history.append(scan)
    del history[: max(0, len(history) - most)]


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
    moved = [between(now.odometry, k.odometry) for k in scans]
    joined = [
        compose(m, np.column_stack([k.ends, np.zeros(len(k.ends))]))[:, :2] for m, k in zip(moved, scans, strict=True)
    ]
    origins = np.array([compose(m, np.array([[*k.sensor, 0.0]]))[0, :2] for m, k in zip(moved, scans, strict=True)])
    seen = free_space.local_features(joined, origins, _CELL_M, _HALF_M)
    found = free_space.match(seen, known, _CANDIDATES).pose
    if found.shape[0]:
        return found, found.shape[0]
    xy = free_xy[rng.integers(free_xy.shape[0], size=_CANDIDATES)]
    return np.column_stack([xy, rng.uniform(-np.pi, np.pi, _CANDIDATES)]), 0


def past_evidence(
    poses: NDArray[np.float64], history: list[KeyScan], now: KeyScan, field: Field, model: Model, gain: float
) -> NDArray[np.float64]:
    """(n,) what the key scans before `now` say for a robot at poses (n, 3) that came there as odometry tells: each as much as
    it showed something new."""
    total = np.zeros(poses.shape[0])
    for key in history:
        if key is not now:
            there = compose(poses, between(now.odometry, key.odometry))
            total += key.worth * gain * class_conditional.fit(there, key.scan, field, model).log_likelihood
    return total


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
def density(at, poses, weights, sd_m, sd_rad):  # type: ignore[no-untyped-def]
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
