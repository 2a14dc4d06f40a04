"""Scans registered to each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core.grid.scan_pairs import best_of, register, surface_of

WALLS = ((4.0, 0), (-3.0, 0), (2.5, 1), (-5.0, 1))
N = 240


def ends(pose: tuple[float, float, float], rng: np.random.Generator | None = None) -> np.ndarray:
    """End points in the sensor's frame: a room with a wing."""
    angles = np.radians(np.linspace(-120, 120, N))
    c, s = np.cos(angles + pose[2]), np.sin(angles + pose[2])
    r = np.full(N, np.inf)
    for wall, axis in WALLS:
        with np.errstate(divide="ignore"):
            t = (wall - pose[axis]) / (c, s)[axis]
        r = np.where((t > 0) & (t < r), t, r)
    if rng is not None:
        r = r + 0.01 * rng.standard_normal(N)
    return np.stack([r * np.cos(angles), r * np.sin(angles)], axis=1)


@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.15, 0.15))
def test_exact_scans_give_the_exact_pose(x: float, y: float, yaw: float) -> None:
    found = register(surface_of(ends((0.0, 0.0, 0.0))), ends((x, y, yaw)), np.zeros(3))
    # normals next to corners are of both walls: they are few, and weighed down
    assert found.pose == pytest.approx((x, y, yaw), abs=2e-3)


def test_noise_leaves_what_the_information_says() -> None:
    rng = np.random.default_rng(1)
    off = []
    for _ in range(60):
        found = register(surface_of(ends((0.0, 0.0, 0.0), rng)), ends((0.1, 0.05, 0.1), rng), np.zeros(3))
        off.append(np.sqrt(np.diag(found.information)) * (found.pose - (0.1, 0.05, 0.1)))
    # both scans are noisy, and neighbours share a normal: up to three times what one noisy scan would leave
    assert np.sqrt((np.array(off) ** 2).mean(axis=0)).max() < 3.0


def test_a_large_turn_is_found_from_several_guesses() -> None:
    guesses = np.array([[0.0, 0.0, a] for a in (-0.6, -0.3, 0.0, 0.3, 0.6)])
    found = best_of(surface_of(ends((0.0, 0.0, 0.0))), ends((0.1, 0.1, 0.55)), guesses)
    assert found.pose == pytest.approx((0.1, 0.1, 0.55), abs=2e-3)
