"""The particles of localize-reliable: hypotheses that are believed, and their rivals."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.motion.odometry import predict
from pfcli.core.weights import normalize

MODE_M, MODE_RAD = 0.75, 0.5
"""Poses within this of each other are one hypothesis."""


Choose = Callable[[NDArray[np.float64], int], NDArray[np.int64]]
"""Parents (count,) by weights (n,), sum 1."""


class Particles(NamedTuple):
    """pose (n, 3), log weight (n,) and p(success) (n,) of each particle; believed (n,): of the hypothesis that was
    reported last."""

    pose: NDArray[np.float64]
    log_w: NDArray[np.float64]
    reliability: NDArray[np.float64]
    believed: NDArray[np.bool_]


def begun(pose: NDArray[np.float64]) -> Particles:
    """Particles at poses (n, 3): nothing speaks for or against them yet."""
    n = pose.shape[0]
    return Particles(pose, np.full(n, -np.log(n)), np.full(n, 0.5), np.ones(n, np.bool_))


def predicted(
    particles: Particles,
    moved: NDArray[np.float64],
    sd: NDArray[np.float64],
    decay: tuple[float, float],
    rng: np.random.Generator,
) -> Particles:
    """Motion of the particles and decay of their reliabilities; failure never becomes success by moving.

    moved, sd: (3,) step and its standard deviations (m, m, rad); decay: 1/m^2 and 1/rad^2.
    """
    pose = predict(particles.pose, moved, sd, rng.standard_normal(particles.pose.shape))
    d2, a2 = moved[0] ** 2 + moved[1] ** 2, moved[2] ** 2
    left = max(0.0, 1.0 - decay[0] * d2 - decay[1] * a2)
    return particles._replace(pose=pose, reliability=particles.reliability * left)


def joined(particles: Particles, more: Particles) -> Particles:
    """The particles and more of them, weights on one scale."""
    return Particles(*(np.concatenate(pair) for pair in zip(particles, more, strict=True)))


def resampled(
    particles: Particles,
    weights: NDArray[np.float64],
    inside: NDArray[np.bool_],
    wanted: int,
    rivals: int,
    choose: Choose,
) -> Particles:
    """The hypothesis that is believed, `inside` (n,), and its rivals, each on its own: a rival keeps its weight, however
    small, so that the evidence for it adds up from scan to scan instead of being resampled away. choose: of the resampler."""
    chosen, log_w, believed = [], [], []
    for k, (members, most) in enumerate(((inside, wanted), (~inside, rivals))):
        index = np.flatnonzero(members)
        mass = float(weights[index].sum())
        if most == 0 or mass <= 1e-300:
            continue
        chosen.append(index[choose(weights[index] / mass, most)])
        log_w.append(np.full(most, np.log(mass / most)))
        believed.append(np.full(most, k == 0))
    index = np.concatenate(chosen)
    together = np.concatenate(log_w)
    together -= normalize(together)[1]
    return Particles(particles.pose[index], together, particles.reliability[index], np.concatenate(believed))
