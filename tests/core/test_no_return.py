"""Readings that mean 'nothing came back', told from readings of walls."""

import numpy as np
import pytest

from pfcli.core.sensor import no_return

RNG = np.random.default_rng(5)
WALLS = np.concatenate([RNG.uniform(0.5, 30, 200_000), RNG.uniform(30, 51, 4_000)]).round(2)
"""Ranges as a drive through corridors gives them: fewer and fewer towards the far end."""
ONE = np.full(9264, 51.15)
FIVE = np.repeat([51.05, 51.06, 51.07, 51.10, 51.16], [20_000, 10_000, 5_500, 3_000, 1_300])


@pytest.mark.parametrize("outliers", [0, 1, 10])
@pytest.mark.parametrize(("top", "first"), [(ONE, 51.15), (FIVE, 51.05)], ids=["one value", "a band of five"])
@pytest.mark.parametrize("stated", [np.inf, 51.0, 80.0])
def test_the_usable_range_ends_below_the_band(top: np.ndarray, first: float, outliers: int, stated: float) -> None:
    above = 51.25 + 0.7 * np.arange(outliers)
    readings = np.concatenate([WALLS, top, above]).astype(np.float32)
    found = no_return.band(readings, stated)
    assert found is not None
    assert found.first_m == pytest.approx(first, abs=1e-4)
    assert first - 0.01 < no_return.usable_m(readings, stated) < first
    assert (readings[readings < 51.0] < no_return.usable_m(readings, stated)).all()


@pytest.mark.parametrize("outliers", [0, 1, 10])
def test_walls_alone_have_no_band(outliers: int) -> None:
    readings = np.concatenate([WALLS, 51.25 + 0.7 * np.arange(outliers)]).astype(np.float32)
    assert no_return.band(readings) is None
    assert no_return.usable_m(readings) == readings.max()


def test_a_room_seen_from_one_place_has_no_band() -> None:
    """Every beam repeats its own wall: the farthest is no more frequent than the others."""
    beams = np.linspace(1.0, 7.3, 181)
    readings = (beams + RNG.normal(0, 0.01, (500, 181))).round(2)
    assert no_return.band(readings) is None


def test_the_end_of_a_corridor_that_the_robot_nears_has_no_band() -> None:
    angles = np.radians(np.arange(-90, 91))
    scans = []
    for k in range(400):
        with np.errstate(divide="ignore"):
            scans.append(np.minimum((40 - 0.05 * k) / np.maximum(np.cos(angles), 1e-9), 1.2 / np.abs(np.sin(angles))))
    assert no_return.band(np.array(scans).round(2)) is None


def test_nothing_to_tell() -> None:
    assert no_return.band(np.array([np.nan, np.inf, 0.0, -1.0])) is None
    assert no_return.usable_m(np.array([np.inf])) == np.inf


def test_one_value_alone_is_no_band_below_the_stated_limit() -> None:
    """A wall all around reads the same everywhere; only at the limit it means that nothing came back."""
    assert no_return.band(np.full(3600, 0.3), stated_m=10.0) is None
    assert no_return.band(np.full(3600, 10.0), stated_m=10.0) is not None
