"""All headings at once: the correlation equals brute force, and drawn headings follow the modes' masses."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core.sensor import heading_match


@given(st.integers(0, 1000), st.sampled_from([72, 120, 360]), st.booleans())
def test_correlation_equals_brute_force(seed: int, bins: int, holes: bool) -> None:
    rng = np.random.default_rng(seed)
    expected = rng.uniform(0.2, 8.0, (5, bins)).astype(np.float32)
    if holes:
        expected[rng.random(expected.shape) < 0.2] = np.nan
    column, z, weight = rng.integers(-bins, bins, 40), rng.uniform(0.2, 8.0, 40), rng.random(40)
    found = heading_match.squared_differences(expected, column, z, weight)
    slow = np.empty_like(found)
    for i in range(5):
        for h in range(bins):
            slow[i, h] = np.nansum(weight * (z - expected[i, (column + h) % bins]) ** 2)
    assert np.abs(found - slow).max() < 2e-3


def test_the_best_heading_is_the_first_of_the_most_probable() -> None:
    assert heading_match.best(np.array([[0.0, 3.0, 3.0], [5.0, 1.0, 2.0]])).tolist() == [1, 0]


def test_headings_are_drawn_within_their_modes_in_proportion() -> None:
    bins = 72
    log_p = np.full((1, bins), -50.0)
    log_p[0, 10], log_p[0, 11], log_p[0, 40] = 0.0, np.log(0.5), np.log(0.25)
    log_p[0, 60:62] = np.log(0.125)
    rng = np.random.default_rng(0)
    n = 20_000
    place, where, mass, drawn = heading_match.strata(np.repeat(log_p, n, axis=0), 2, 3, rng.random((n, 3)))
    assert place.tolist() == np.repeat(np.arange(n), 3).tolist()
    first, second, rest = where.reshape(n, 3).T
    assert np.allclose(mass.reshape(n, 3), np.log([1.5, 0.25, 0.25]))
    share = np.mean(np.rint(first) == 10)
    assert abs(share - 2 / 3) < 4 * np.sqrt(2 / 9 / n)
    assert (np.abs(second - 40) <= 0.5).all()
    assert (np.abs(rest - 60.5) <= 1.0).all()
    assert abs(np.mean(rest < 60.5) - 0.5) < 4 * np.sqrt(0.25 / n)
    assert set(np.round(np.unique(drawn[::3]), 6)) <= {0.0, round(float(np.log(0.5)), 6)}


def test_drawn_headings_stand_for_the_whole_row() -> None:
    """Weighed by mass over density, what is drawn estimates any sum over the row, also of what no mode holds."""
    rng = np.random.default_rng(1)
    log_p, target = rng.normal(0.0, 2.0, 120), rng.exponential(size=120)
    n = 50_000
    place, where, mass, drawn = heading_match.strata(np.repeat(log_p[None], n, axis=0), 3, 4, rng.random((n, 4)))
    terms = np.exp(mass - drawn) * target[np.rint(where).astype(int) % 120]
    sums = np.bincount(place, terms, n)
    assert abs(sums.mean() - target.sum()) < 4 * sums.std() / np.sqrt(n)
