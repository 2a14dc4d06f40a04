"""Paths that agree with what poses say of each other."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pfcli.core.geometry import between, compose, wrap
from pfcli.core.graph.pose_graph import Edges, relax


def _edges(pairs: list[tuple[int, int]], measured: NDArray[np.float64], sd: tuple[float, float, float]) -> Edges:
    first, second = np.array(pairs, np.int64).reshape(-1, 2).T
    information = np.broadcast_to(np.diag(np.square(sd) ** -1.0), (len(pairs), 3, 3)).copy()
    return Edges(first, second, measured.reshape(-1, 3), information)


def _ring(n: int) -> NDArray[np.float64]:
    angle = 2 * np.pi * np.arange(n) / n
    return np.stack([5 * np.sin(angle), 5 - 5 * np.cos(angle), wrap(angle)], axis=1)


def _seen(poses: NDArray[np.float64], pairs: list[tuple[int, int]]) -> NDArray[np.float64]:
    first, second = np.array(pairs, np.int64).reshape(-1, 2).T
    return np.asarray(between(poses[first], poses[second]))


def _along(n: int) -> list[tuple[int, int]]:
    return [(k, k + 1) for k in range(n - 1)]


NONE = _edges([], np.empty((0, 3)), (1, 1, 1))


def test_exact_measurements_are_met_from_afar() -> None:
    truth = _ring(30)
    pairs = [*_along(30), (29, 0), (3, 17)]
    start = truth + np.random.default_rng(0).normal(0, [0.5, 0.5, 0.3], truth.shape)
    start[0] = truth[0]
    found = relax(start, _edges(pairs, _seen(truth, pairs), (0.1, 0.1, 0.05)), NONE)
    assert np.allclose(between(found.poses, truth), 0, atol=1e-6)
    assert found.weights.size == 0


def test_like_a_dense_solver() -> None:
    rng, n = np.random.default_rng(1), 12
    truth = _ring(n)
    pairs, sd = [*_along(n), (11, 0), (2, 9)], (0.1, 0.2, 0.05)
    edges = _edges(pairs, _seen(truth, pairs) + rng.normal(0, sd, (len(pairs), 3)), sd)
    found = relax(truth, edges, NONE).poses

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        poses = np.concatenate([truth[:1], x.reshape(-1, 3)])
        off = between(poses[edges.first], poses[edges.second]) - edges.measured
        off[:, 2] = wrap(off[:, 2])
        squares = np.square(off / sd).sum(axis=1, keepdims=True)
        return np.asarray((off / sd / np.sqrt(1 + squares / 36)).ravel())

    best = least_squares(residuals, truth[1:].ravel()).x.reshape(-1, 3)
    assert np.allclose(found[1:, :2], best[:, :2], atol=1e-4)
    assert np.allclose(wrap(found[1:, 2] - best[:, 2]), 0, atol=1e-4)


def _drifted(n: int, turn: float) -> tuple[NDArray[np.float64], NDArray[np.float64], Edges]:
    """A ring of n poses, the path of an odometry that turns too far, and its edges."""
    truth = _ring(n)
    steps = _seen(truth, _along(n)) + np.array([0.0, 0.0, turn])
    path = np.zeros((n, 3))
    for k in range(n - 1):
        path[k + 1] = compose(path[k : k + 1], steps[k : k + 1])[0]
    return truth, path, _edges(_along(n), steps, (0.02, 0.02, 0.01))


def test_closures_that_agree_bend_a_drifted_path_and_a_wrong_one_does_not() -> None:
    n = 100
    truth, path, odometry = _drifted(n, 0.01)
    assert np.hypot(*(path - truth)[:, :2].T).max() > 2
    pairs = [(99, 0), (98, 1), (97, 2), (95, 3), (60, 20)]
    measured = _seen(truth, pairs)
    measured[4] += np.array([3.0, -2.0, 0.5])
    found = relax(path, odometry, _edges(pairs, measured, (0.03, 0.03, 0.01)))
    assert (found.weights[:4] > 0.8).all()
    assert found.weights[4] < 0.01
    assert np.hypot(*(found.poses - truth)[:, :2].T).max() < 0.2


def test_draws_have_the_covariance_of_the_normal_equations() -> None:
    """Of a chain without closures: heading errors add up, and swing what comes after."""
    n, draws, sd = 6, 20_000, (0.1, 0.05, 0.02)
    path = np.stack([np.arange(n, dtype=np.float64), np.zeros(n), np.zeros(n)], axis=1)
    found = relax(path, _edges(_along(n), _seen(path, _along(n)), sd), NONE, np.random.default_rng(2), draws)
    steps = np.arange(1, n)
    expected = np.zeros((n, 3, 3))
    for k in steps:
        left = np.arange(k)[::-1]  # of each error, how many steps of 1 m follow
        expected[k] = np.diag([k * sd[0] ** 2, k * sd[1] ** 2 + sd[2] ** 2 * (left**2).sum(), k * sd[2] ** 2])
        expected[k, 1, 2] = expected[k, 2, 1] = sd[2] ** 2 * left.sum()
    diagonal = np.einsum("tii->ti", expected)
    error = np.sqrt((diagonal[:, :, None] * diagonal[:, None, :] + expected**2) / draws)
    assert (np.abs(found.covariance() - expected) <= 5 * error).all()
    # seen from another pose than the first, only what lies between counts
    seen = found.relative_sd(np.array([2, 0]), np.array([4, 4]))
    assert seen[0] == pytest.approx([np.sqrt((2 * 0.1**2 + 2 * 0.05**2 + 0.02**2) / 2), 0.02 * np.sqrt(2)], rel=0.03)
    assert seen[1] == pytest.approx([np.sqrt(np.trace(expected[4][:2, :2]) / 2), 0.04], rel=0.03)
