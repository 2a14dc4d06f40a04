"""A ceiling over a drive."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.replay.frames.ceiling import ceiling_m


@given(st.floats(2.2, 4.0), st.floats(0.2, 0.9), st.integers(0, 99))
def test_what_piles_up_under_nothing_is_the_ceiling(top: float, share: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    walls = rng.uniform(0.2, top, int(4000 * (1 - share)))
    heights = np.concatenate([walls, top + 0.01 * rng.standard_normal(int(4000 * share))])
    found = ceiling_m(heights, 1.0)
    assert top - 0.1 <= found <= top


def test_walls_alone_are_no_ceiling() -> None:
    rng = np.random.default_rng(1)
    assert ceiling_m(rng.uniform(0.1, 5.0, 4000), 1.0) == math.inf
    assert ceiling_m(1.0 + rng.exponential(0.8, 4000), 1.0) == math.inf
    assert ceiling_m(np.full(20, 2.5), 1.0) == pytest.approx(math.inf)
