"""Range and bearing: Jacobians against differences, the EKF of a landmark against the textbook, blocks that particles share."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core import landmark_store
from pfcli.core.jit import kernel
from pfcli.core.landmark_store import BLOCK, own, read
from pfcli.core.sensor import range_bearing


@kernel
def _expected(pose, lx, ly, out, hv, hf):  # type: ignore[no-untyped-def]
    range_bearing.expected(pose, lx, ly, out, hv, hf)


@kernel
def _updated(mark, pose, z, noise):  # type: ignore[no-untyped-def]
    out, hv, hf, s = np.empty(2), np.empty((2, 3)), np.empty((2, 2)), np.empty(3)
    range_bearing.expected(pose, mark[0], mark[1], out, hv, hf)
    range_bearing.spread2(hf, mark, noise, s)
    range_bearing.update(mark, hf, s, z[0] - out[0], z[1] - out[1])


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3))
def test_jacobians_are_the_differences(x: float, y: float, yaw: float) -> None:
    pose, mark = np.array([x, y, yaw]), np.array([6.0, 2.0])
    out, hv, hf = np.empty(2), np.empty((2, 3)), np.empty((2, 2))
    _expected(pose, *mark, out, hv, hf)
    for k in range(5):
        step, moved = 1e-6, np.array([*pose, *mark])
        moved[k] += step
        there = np.empty(2)
        _expected(moved[:3], moved[3], moved[4], there, np.empty((2, 3)), np.empty((2, 2)))
        slope = (there - out) / step
        slope[1] = np.remainder((there[1] - out[1]) + np.pi, 2 * np.pi) / step - np.pi / step
        assert np.allclose(slope, hv[:, k] if k < 3 else hf[:, k - 3], atol=1e-4)


def test_a_landmark_is_updated_as_the_textbook_says() -> None:
    pose, noise = np.array([0.5, -0.2, 0.3]), np.array([0.04, 0.001])
    mark = np.array([4.0, 2.0, 0.3, 0.05, 0.2, 1.0, 1.0])
    z = np.array([4.3, 0.2])
    out, hv, hf = np.empty(2), np.empty((2, 3)), np.empty((2, 2))
    _expected(pose, mark[0], mark[1], out, hv, hf)
    p = np.array([[0.3, 0.05], [0.05, 0.2]])
    gain = p @ hf.T @ np.linalg.inv(hf @ p @ hf.T + np.diag(noise))
    mean, cov = mark[:2] + gain @ (z - out), (np.eye(2) - gain @ hf) @ p
    _updated(mark, pose, z, noise)
    assert np.allclose(mark[:2], mean)
    assert np.allclose([mark[2], mark[3], mark[4]], [cov[0, 0], cov[0, 1], cov[1, 1]])


@kernel
def _write(store, i, column, value):  # type: ignore[no-untyped-def]
    block = own(store, i, column)
    store.pool[block, column % BLOCK, 0] = value
    store.pool[block, column % BLOCK, 5] = 1.0


@kernel
def _there(store, i, column):  # type: ignore[no-untyped-def]
    return read(store, i, column)[0] >= 0


def test_shared_blocks_behave_like_copies() -> None:
    """Random writes and resamplings beside plain copies of everything: the same landmarks, and no block is lost."""
    rng, n, columns = np.random.default_rng(0), 7, 40
    store, plain = landmark_store.reserve(landmark_store.empty(n), columns), np.zeros((n, columns))
    for _ in range(400):
        i, column = int(rng.integers(n)), int(rng.integers(columns))
        plain[i, column] = rng.random()
        _write(store, i, column, plain[i, column])
        if rng.random() < 0.1:
            ancestors = rng.integers(n, size=n)
            store, plain = landmark_store.choose(store, ancestors), plain[ancestors]
    for i in range(n):
        assert np.array_equal(landmark_store.landmarks(store, i)[:columns, 0], plain[i])
    assert store.refs.sum() == (store.table >= 0).sum()
    assert int(store.top[0]) == (store.refs == 0).sum()
    assert not _there(store, 0, columns - 1) or plain[0, columns - 1] != 0.0


@pytest.mark.parametrize("columns", [1, 16, 17, 200])
def test_room_is_made_without_losing_what_was_there(columns: int) -> None:
    store = landmark_store.reserve(landmark_store.empty(3), 2)
    _write(store, 1, 0, 5.0)
    grown = landmark_store.reserve(store, columns)
    assert landmark_store.landmarks(grown, 1)[0, 0] == 5.0
    assert grown.table.shape[1] * BLOCK >= columns
