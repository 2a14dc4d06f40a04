"""Clouds and planes that lean, seen from above."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core import rigid
from pfcli.core.grid.scan_projection import projected, sliced


@given(st.tuples(*[st.floats(-0.6, 0.6)] * 3), st.integers(0, 99))
def test_a_slice_is_the_slow_one(turn: tuple[float, float, float], seed: int) -> None:
    """Nearest surface of each bearing: the mean of what lies within 10 cm of the nearest point between two heights."""
    rng = np.random.default_rng(seed)
    motion = rigid.from_euler((0.3, -0.2, 1.0), *turn)
    points = rng.uniform(-4, 4, (400, 3)).astype(np.float32)
    points[::17] = np.nan
    ranges, bearings, used = sliced(points, motion, (0.1, 2.0), 36)
    world = points.astype(float) @ motion[:3, :3].T + motion[:3, 3]
    kept = world[(world[:, 2] >= 0.1) & (world[:, 2] <= 2.0)][:, :2] - motion[:2, 3]
    assert used == len(kept)
    bins = np.minimum(35, ((np.arctan2(kept[:, 1], kept[:, 0]) + np.pi) / (2 * np.pi) * 36).astype(int))
    for k in range(36):
        mine = kept[bins == k]
        if not len(mine):
            assert np.isnan(ranges[k])
            continue
        far = np.hypot(*mine.T)
        mean = mine[far < far.min() + 0.1].mean(axis=0)
        assert ranges[k] == pytest.approx(np.hypot(*mean), rel=1e-5)
        assert bearings[k] == pytest.approx(np.arctan2(mean[1], mean[0]), abs=1e-9)


@given(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), st.floats(0.2, 2.0))
def test_a_plane_that_leans_is_the_slow_one(roll: float, pitch: float, height: float) -> None:
    motion = rigid.from_euler((0.0, 0.0, height), roll, pitch, 0.4)
    given_m = np.array([1.0, 2.0, np.inf, 0.01, np.nan, 5.0, 3.0], np.float32)
    ranges, bearings, off = projected(given_m, (-1.0, 0.3), (0.05, 8.0), motion[:3, :3], height, (0.1, 2.2))
    left = 0
    for k, r in enumerate(given_m.tolist()):
        a = -1.0 + 0.3 * k
        d = motion[:3, :3] @ np.array([np.cos(a), np.sin(a), 0.0])
        assert bearings[k] == pytest.approx(np.arctan2(d[1], d[0]))
        up = height + min(r, 8.0) * d[2]
        if not r > 0.05:
            assert np.isnan(ranges[k])
        elif not 0.1 <= up <= 2.2:
            left += 1
            assert np.isnan(ranges[k])
        else:
            assert ranges[k] == pytest.approx(r * np.hypot(d[0], d[1]), rel=1e-6)
    assert off == left
