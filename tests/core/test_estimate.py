import numpy as np
import pytest

from pfcli.core import estimate
from pfcli.core.particles import uniform
from pfcli.core.resample import kld, systematic


def test_the_mean_heading_is_circular() -> None:
    poses = np.array([[0.0, 0.0, np.pi - 0.1], [0.0, 0.0, -np.pi + 0.3]])
    found = estimate.whole(poses, np.array([0.5, 0.5]))
    assert found.pose[2] == pytest.approx(-np.pi + 0.1)
    assert found.cov[2, 2] == pytest.approx(0.04)


def test_mean_and_covariance_equal_numpy_where_headings_do_not_wrap() -> None:
    rng = np.random.default_rng(1)
    poses, w = rng.normal(0, [1.0, 2.0, 0.2], (500, 3)), rng.random(500)
    w /= w.sum()
    found = estimate.whole(poses, w)
    centred = poses - w @ poses
    assert found.pose == pytest.approx(w @ poses, abs=1e-3)
    assert found.cov == pytest.approx((centred * w[:, None]).T @ centred, abs=1e-3)


def test_of_two_hypotheses_the_heavier_is_the_estimate_not_the_middle() -> None:
    rng = np.random.default_rng(2)
    left, right = rng.normal([0, 0, 0], 0.05, (600, 3)), rng.normal([8, 0, 1], 0.05, (400, 3))
    found = estimate.densest(np.concatenate([left, right]), np.full(1000, 1e-3), 0.75, 0.5)
    # the mean of 600 values with deviation 0.05, five standard errors
    assert np.abs(found.pose).max() < 5 * 0.05 / np.sqrt(600)
    assert found.mass == pytest.approx(0.6)


def test_the_kld_bound_is_fox_equation_13() -> None:
    def fox(k: int) -> float:
        a = 2 / (9 * (k - 1))
        return (k - 1) / (2 * 0.05) * (1 - a + np.sqrt(a) * 2.33) ** 3

    for k in (2, 10, 100, 1000):
        assert kld.bound(k, 0.05, 2.33) == int(np.ceil(fox(k)))
    assert kld.bound(1, 0.05, 2.33) == 1


def test_occupied_bins_are_counted_up_to_rare_collisions() -> None:
    rng = np.random.default_rng(4)
    poses = uniform(np.array([[0.0, 0.0]]), 5.0, 2000, rng)
    keys = {(int(np.floor(x / 0.5)), int(np.floor(y / 0.5)), int(np.floor((t + np.pi) / 0.26))) for x, y, t in poses}
    found = kld.occupied_bins(poses, np.arange(2000), 0.5, 0.26)
    # hashed into at least 8 slots a pose, about 1 in 16 new bins meets a taken slot at most
    assert len(keys) * (1 - 1 / 12) < found <= len(keys)


def test_as_many_are_drawn_as_the_bound_needs_for_what_they_hit() -> None:
    rng = np.random.default_rng(5)
    near, apart = rng.normal(0.1, 0.01, (3000, 3)), uniform(np.array([[0.0, 0.0]]), 9.0, 3000, rng)
    weights, all_of, few = np.full(3000, 1 / 3000), np.arange(3000), np.arange(40)

    def size(poses: np.ndarray, cluster: np.ndarray, limit: int, error: float) -> int:
        return int(kld.sample_size(poses, weights, cluster, 0.5, 20, limit, error, 0.5, 0.26))

    assert size(near, all_of, 50_000, 0.0) == 50_000
    assert size(near, all_of, 50_000, 0.01) == 20
    assert size(near, all_of, 7, 0.01) == 7
    hit = kld.occupied_bins(apart, all_of, 0.5, 0.26)
    # the more slots, the rarer two bins meet in one
    assert size(apart, all_of, 10**6, 0.05) == pytest.approx(kld.bound(hit, 0.05, 2.33), rel=1 / 12)
    assert size(apart, all_of, 5000, 0.05) == 5000
    # 40 members ask for more than the first 160 draws
    wanted = kld.bound(kld.occupied_bins(apart, few, 0.5, 0.26), 0.05, 2.33)
    assert size(apart, few, 10**6, 0.05) == pytest.approx(wanted, rel=1 / 12)
    assert wanted > 160


def test_choosing_any_number_keeps_the_proportions() -> None:
    weights = np.array([1.0, 3.0, 0.0, 4.0])
    counts = np.bincount(systematic.choose(weights, 0.4, 80), minlength=4)
    assert np.abs(counts - 80 * weights / 8).max() < 1
