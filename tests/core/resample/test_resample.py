"""Resamplers: counts, order, and what the dispersal does."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli import registry
from pfcli.api.contract_tests import a_resampler_is_unbiased
from pfcli.core.resample import csw, gdr, schemes, stratified, systematic
from pfcli.errors import UsageError
from pfcli.systems.shared import resampling

WEIGHTS = st.lists(st.floats(1e-6, 1.0), min_size=2, max_size=40)


def _normal(values: list[float]) -> np.ndarray:
    w = np.array(values)
    return w / w.sum()


@given(WEIGHTS, st.floats(0, 1, exclude_max=True))
def test_systematic_counts_are_within_one_of_their_share(values: list[float], u: float) -> None:
    w = _normal(values)
    counts = np.bincount(systematic.ancestors(w, np.array([u])), minlength=w.size)
    assert counts.sum() == w.size
    assert (np.abs(counts - w.size * w) < 1 + 1e-9).all()


@given(WEIGHTS, st.floats(0, 1, exclude_max=True), st.sampled_from(["descending", "none"]))
def test_csw_counts_are_within_one_whatever_the_order(values: list[float], u: float, sort: str) -> None:
    w = _normal(values)
    counts = np.bincount(csw.ancestors(w, np.array([u]), sort), minlength=w.size)
    assert (np.abs(counts - w.size * w) < 1 + 1e-9).all()


def test_csw_sums_the_heaviest_first() -> None:
    w = np.array([0.1, 0.6, 0.3])
    assert csw.order(w, "descending").tolist() == [1, 2, 0]
    assert csw.ancestors(w, np.array([0.5])).tolist() == [1, 1, 2]


def test_stratified_is_unbiased() -> None:
    rng = np.random.default_rng(1)
    w = np.array([0.05, 0.15, 0.3, 0.5])
    runs = 4000
    counts = np.zeros(4)
    for _ in range(runs):
        counts += np.bincount(stratified.ancestors(w, rng.random(4)), minlength=4)
    # a count per run has a variance of at most 1: five standard errors of the mean
    assert np.abs(counts / runs - 4 * w).max() < 5 / np.sqrt(runs)


SCHEMES = {"csw": schemes.csw, "multinomial": schemes.multinomial, "stratified": schemes.stratified}
SCHEMES["systematic"] = schemes.systematic


@pytest.mark.parametrize("name", SCHEMES)
def test_any_number_of_offspring_is_unbiased(name: str) -> None:
    a_resampler_is_unbiased(SCHEMES[name])


def test_a_biased_resampler_is_found_out() -> None:
    def always_first(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        found = schemes.multinomial(weights, count, rng)
        found[0] = 0
        return found

    with pytest.raises(AssertionError, match="biased for 1 offspring"):
        a_resampler_is_unbiased(always_first)


def test_every_resampler_is_found_by_its_name_and_has_a_help() -> None:
    assert set(SCHEMES) <= set(registry.resampler_names())
    for name in registry.resampler_names():
        assert (registry.resampler(name).__doc__ or "").splitlines()[0].endswith("."), name
    with pytest.raises(UsageError, match="there is no resampler 'metropolis'; known: csw, multinomial"):
        registry.resampler("metropolis")


def test_a_resampler_that_gives_nonsense_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    weights, rng = np.full(3, 1 / 3), np.random.default_rng(0)
    for wrong in (np.zeros(2, np.int64), np.zeros(3), np.array([0, 1, 3])):
        monkeypatch.setattr(resampling, "resampler", lambda _, given=wrong: lambda *_: given)
        with pytest.raises(UsageError, match="resampler 'mine' gave"):
            resampling.by_name("mine", weights, 3, rng)


@pytest.mark.parametrize("n", [5, 20, 100])
def test_dispersal_at_average_weight_is_alpha_whatever_n(n: int) -> None:
    assert gdr.scales(np.full(n, 1 / n), n, 9.0) == pytest.approx(np.ones(n))


def test_dispersal_is_inverse_to_the_weight_and_capped() -> None:
    assert gdr.scales(np.array([0.5, 0.1, 0.001]), 10, 9.0) == pytest.approx([0.2, 1.0, 9.0])


def test_dispersal_has_the_variance_of_eq_8() -> None:
    rng = np.random.default_rng(3)
    n, sigma = 100_000, np.array([0.01, 0.02, 0.005])
    out = gdr.disperse(
        np.zeros((n, 3)), np.zeros(n, np.int64), np.full(n, 4.0), sigma, False, rng.standard_normal((n, 3))
    )
    # relative standard error of a standard deviation: 1 / sqrt(2 n)
    assert out.std(axis=0) / (2 * sigma) == pytest.approx(np.ones(3), abs=5 / np.sqrt(2 * n))


def test_first_offspring_of_each_parent_stays() -> None:
    poses = np.arange(12.0).reshape(4, 3)
    ancestors = np.array([2, 2, 0, 2])
    out = gdr.disperse(poses, ancestors, np.ones(4), np.ones(3), True, np.ones((4, 3)))
    assert (out[[0, 2]] == poses[[0, 2]]).all()
    assert (out[[1, 3]] == poses[[1, 3]] + 1).all()
