"""Random numbers depend on seed, purpose and stamp alone; purposes of other packages never meet ours."""

import subprocess
import sys

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pfcli.rng import Draw, Purpose, purpose_of, rng_for


@given(st.text(), st.text())
def test_a_purpose_of_another_package_is_one_word_beyond_ours(distribution: str, name: str) -> None:
    found = purpose_of(distribution, name)
    assert 2**16 <= found < 2**32
    assert max(Purpose) < 2**16
    assert found == purpose_of(distribution, name)


def test_names_of_purposes_lie_apart() -> None:
    found = {purpose_of(f"package-{k}", name) for k in range(100) for name in ("pick", "shuffle", "pic", "k")}
    assert len(found) == 400


def test_a_purpose_is_the_same_number_in_every_process() -> None:
    """It is part of recorded results: neither the hash seed nor a version may change it."""
    assert purpose_of("my-filter", "shuffle") == 1399664748
    code = "from pfcli.rng import purpose_of; print(purpose_of('my-filter', 'shuffle'))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout) == 1399664748


def test_a_draw_of_ones_own_shifts_no_other() -> None:
    mine, plain, with_mine = purpose_of("my-filter", "shuffle"), Draw(7), Draw(7)
    own = with_mine(mine, 5).random(3)
    assert np.array_equal(plain(Purpose.MOTION, 5).random(3), with_mine(Purpose.MOTION, 5).random(3))
    assert np.array_equal(own, rng_for(7, mine, 5).random(3))
    assert not np.array_equal(own, with_mine(mine, 5).random(3)), "the second draw at a stamp is another one"
    assert not np.array_equal(own, rng_for(8, mine, 5).random(3))
