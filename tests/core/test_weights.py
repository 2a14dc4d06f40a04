import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core.weights import effective_sample_size, normalize
from pfcli.errors import FilterDegenerate


@given(st.lists(st.floats(-700, 700), min_size=1, max_size=50), st.floats(-1e6, 1e6))
def test_weights_sum_to_one_and_ignore_a_shift(values: list[float], shift: float) -> None:
    log_w = np.array(values)
    weights, evidence = normalize(log_w)
    moved, moved_evidence = normalize(log_w + shift)
    assert weights.sum() == pytest.approx(1.0)
    assert moved == pytest.approx(weights, abs=1e-6)
    assert moved_evidence == pytest.approx(evidence + shift, rel=1e-9, abs=1e-6)


def test_no_weight_at_all_is_an_error_not_a_nan() -> None:
    with pytest.raises(FilterDegenerate):
        normalize(np.full(4, -np.inf))


def test_n_eff_is_n_for_equal_weights_and_1_for_one() -> None:
    assert effective_sample_size(np.full(8, 1 / 8)) == pytest.approx(8)
    assert effective_sample_size(np.array([1.0, 0, 0])) == pytest.approx(1)
