"""Particles that take a step of odometry."""

import numpy as np

from pfcli.core.geometry import compose
from pfcli.core.motion.odometry import Noise, predict, standard_deviations


def test_particles_follow_the_step_and_its_noise() -> None:
    rng = np.random.default_rng(0)
    poses = rng.uniform(-3, 3, (50, 3))
    step = np.array([0.4, -0.1, 0.3])
    exact = predict(poses, step, np.zeros(3), np.zeros((50, 3)))
    assert np.allclose(exact, compose(poses, step[None]))
    n = 100_000
    sd = standard_deviations(step, Noise(0.1, 0.02, 0.005, 0.1, 0.05, 0.003))
    moved = predict(np.zeros((n, 3)), step, sd, rng.standard_normal((n, 3)))
    assert np.abs(moved.mean(axis=0) - step).max() < 4.5 * sd.max() / np.sqrt(n)
    assert np.allclose(moved.std(axis=0), sd, rtol=4.5 / np.sqrt(2 * n))
