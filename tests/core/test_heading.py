"""All headings at once: the correlation equals brute force, and drawn headings follow the modes' masses."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core.sensor import heading


@given(st.integers(0, 1000), st.sampled_from([72, 120, 360]), st.booleans())
def test_correlation_equals_brute_force(seed: int, bins: int, holes: bool) -> None:
    rng = np.random.default_rng(seed)
    expected = rng.uniform(0.2, 8.0, (5, bins)).astype(np.float32)
    if holes:
        expected[rng.random(expected.shape) < 0.2] = np.nan
    column, z, weight = rng.integers(-bins, bins, 40), rng.uniform(0.2, 8.0, 40), rng.random(40)
    found = heading.squared_differences(expected, column, z, weight)
    slow = np.empty_like(found)
    for i in range(5):
        for h in range(bins):
            slow[i, h] = np.nansum(weight * (z - expected[i, (column + h) % bins]) ** 2)
    assert np.abs(found - slow).max() < 2e-3


def test_the_best_heading_is_the_first_of_the_most_probable() -> None:
    assert heading.best(np.array([[0.0, 3.0, 3.0], [5.0, 1.0, 2.0]])).tolist() == [1, 0]


def test_headings_are_drawn_within_their_modes_in_proportion() -> None:
    bins = 72
    log_p = np.full((1, bins), -50.0)
    log_p[0, 10], log_p[0, 11], log_p[0, 40] = 0.0, np.log(0.5), np.log(0.25)
    rng = np.random.default_rng(0)
    n = 20_000
    place, where, mass, drawn = heading.modes(np.repeat(log_p, n, axis=0), 2, 3, rng.random((n, 2)))
    assert place.shape == (2 * n,)
    first, second = where[::2], where[1::2]
    assert np.allclose(mass[::2], np.log(1.5))
    assert np.allclose(mass[1::2], np.log(0.25))
    share = np.mean(np.rint(first) == 10)
    assert abs(share - 2 / 3) < 4 * np.sqrt(2 / 9 / n)
    assert (np.abs(second - 40) <= 0.5).all()
    assert set(np.round(np.unique(drawn[::2]), 6)) <= {0.0, round(float(np.log(0.5)), 6)}
