import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core.geometry import between, cholesky3, compose, solve3, spread_residual, wrap

POSE = st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-3.1, 3.1))


def _matrix(pose: np.ndarray) -> np.ndarray:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0, 0, 1]])


@given(POSE, POSE)
def test_compose_is_the_product_of_transforms(a: tuple[float, ...], b: tuple[float, ...]) -> None:
    both = compose(np.array([a]), np.array([b]))[0]
    assert _matrix(both) == pytest.approx(_matrix(np.array(a)) @ _matrix(np.array(b)), abs=1e-6)


@given(POSE, POSE)
def test_between_undoes_compose(a: tuple[float, ...], b: tuple[float, ...]) -> None:
    both = compose(np.array([a]), np.array([b]))
    back = between(np.array([a]), both)[0]
    assert back[:2] == pytest.approx(b[:2], abs=1e-6)
    assert wrap(back[2] - b[2]) == pytest.approx(0, abs=1e-9)


def test_cholesky_solves_like_numpy() -> None:
    rng = np.random.default_rng(0)
    m = rng.standard_normal((3, 3))
    a = m @ m.T + np.eye(3)
    low, x, b = np.zeros((3, 3)), np.empty(3), rng.standard_normal(3)
    assert cholesky3(a, low) == pytest.approx(np.linalg.slogdet(a)[1])
    solve3(low, b, x)
    assert x == pytest.approx(np.linalg.solve(a, b))


def test_the_residual_of_an_update_is_spread_along_the_way() -> None:
    odometry = np.array([[0.0, 0, 0], [0.25, 0, 0], [0.75, 0, 0]])
    start, end, reached = np.zeros(3), np.array([1.0, 0.4, 0.0]), np.array([1.0, 0, 0])
    assert spread_residual(start, end, odometry, reached) == pytest.approx(
        np.array([[0.0, 0, 0], [0.25, 0.1, 0], [0.75, 0.3, 0]])
    )
