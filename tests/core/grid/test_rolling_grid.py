import numpy as np
import pytest

from pfcli.core.grid import rolling_grid as lh


def test_a_wall_is_explained_by_the_last_metres_and_a_passer_by_is_not() -> None:
    history = lh.empty()
    for k in range(30):
        way = 0.1 * k
        pose = np.array([way, 0.0, 0.0])
        wall = np.stack([np.linspace(-2, 6, 60) - way, np.full(60, 1.0)])
        walker = np.array([[3.0 - 0.3 * k - way], [0.2]])
        points = np.concatenate([wall, walker], axis=1).astype(np.float32)
        if k == 29:
            away = lh.explained_m(history, pose, points, np.float32(way), 15.0)
            assert np.median(away[0, :60]) <= 0.1
            assert (away[1, :60] <= 0.1).mean() > 0.8
            assert np.isinf(away[1, 60])
        lh.remember(history, pose, points, np.float32(way), 15.0)


def test_what_lies_too_far_behind_is_forgotten() -> None:
    history = lh.empty()
    point = np.array([[1.0], [0.0]], np.float32)
    for way in np.arange(0.0, 1.9, 0.1):
        lh.remember(history, np.zeros(3), point, np.float32(way), 5.0)
    assert lh.explained_m(history, np.zeros(3), point, np.float32(2.0), 5.0)[1, 0] == 0.0
    assert np.isinf(lh.explained_m(history, np.zeros(3), point, np.float32(9.0), 5.0)).all()


@pytest.mark.parametrize(("passes", "surface"), [(2, False), (20, True)])
def test_where_people_pass_now_and_then_is_no_surface(passes: int, surface: bool) -> None:
    """Two people who walk the same line hit a place three times each; a wall is hit in every scan."""
    history = lh.empty()
    point = np.array([[2.0], [0.0]], np.float32)
    hits = 3 * passes if passes == 2 else passes
    for way in np.linspace(0.0, 2.0, hits):
        lh.remember(history, np.zeros(3), point, np.float32(way), 15.0)
    away = lh.explained_m(history, np.zeros(3), point, np.float32(2.0), 15.0)
    assert away[0, 0] == 0.0
    assert np.isfinite(away[1, 0]) == surface


def test_a_marked_thing_is_known_near_its_place_and_for_the_window_only() -> None:
    """Marked from one pose, seen from another that odometry tells."""
    history = lh.empty()
    lh.mark(history, np.array([1.0, 0.0, 0.0]), np.array([[2.0], [0.0]], np.float32), np.float32(1.0))
    seen = np.array([[0.0, 0.0, 0.0], [-1.0, -1.15, -1.6]], np.float32)  # from (3, 1), looking along x
    pose = np.array([3.0, 1.0, 0.0])
    assert lh.marked(history, pose, seen, np.float32(2.0), 15.0).tolist() == [True, True, False]
    assert not lh.marked(history, pose, seen, np.float32(17.0), 15.0).any()
