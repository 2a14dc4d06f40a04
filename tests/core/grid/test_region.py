import numpy as np
import pytest

from pfcli.core.grid import region
from pfcli.core.grid.region import INSIDE, OUTSIDE, WALL


def _half_known() -> np.ndarray:
    """A corridor of 2 x 10 m, walls around it, the eastern half unknown."""
    cells = np.full((60, 220), -1, np.int8)
    cells[10:50, 10:110] = 0
    cells[9, 10:110] = cells[50, 10:110] = 1
    cells[9:51, 9] = 1
    return cells


def test_the_frontier_is_where_free_meets_unknown_and_only_there() -> None:
    found = region.region_of(_half_known(), 0.05, (0.0, 0.0, 0.0))
    near = found.edge_xy[found.edge_m == 0.0]
    assert near[:, 0] == pytest.approx(109.5 * 0.05)
    assert near[:, 1].min() > 10 * 0.05
    assert near[:, 1].max() < 50 * 0.05
    assert (np.diff(found.edge_m) >= 0).all()


def test_gaps_too_narrow_for_the_robot_and_small_pockets_are_no_frontier() -> None:
    cells = _half_known()
    cells[9, 60:62] = 0  # a gap of 0.1 m in the wall
    cells[30:36, 50:56] = -1  # an unknown patch of 0.09 m^2
    found = region.region_of(cells, 0.05, (0.0, 0.0, 0.0))
    assert (found.edge_xy[found.edge_m == 0.0][:, 0] > 5.4).all()
    places = region.places(found, np.array([[2.6, 1.6, 0.0], [8.0, 1.5, 0.0], [-3.0, 0.0, 0.0], [4.0, 0.47, 0.0]]))
    assert places.tolist() == [INSIDE, OUTSIDE, OUTSIDE, WALL]


def test_a_turned_origin_turns_the_region() -> None:
    plain = region.region_of(_half_known(), 0.05, (0.0, 0.0, 0.0))
    turned = region.region_of(_half_known(), 0.05, (3.0, -2.0, 0.5))
    c, s = np.cos(0.5), np.sin(0.5)
    expected = np.array([3.0, -2.0]) + plain.free_xy @ np.array([[c, s], [-s, c]])
    assert turned.free_xy == pytest.approx(expected)
    assert (region.places(turned, np.column_stack([expected, np.zeros(len(expected))])) == INSIDE).all()


def test_a_move_through_a_wall_is_noticed() -> None:
    found = region.region_of(_half_known(), 0.05, (0.0, 0.0, 0.0))
    assert region.crosses_wall(found.place, found.frame, 3.0, 0.7, 3.0, 0.3)
    assert not region.crosses_wall(found.place, found.frame, 3.0, 0.7, 3.5, 0.7)
    assert not region.crosses_wall(found.place, found.frame, 5.3, 1.0, 5.8, 1.0)


def test_a_clear_way_meets_no_wall() -> None:
    found = region.region_of(_half_known(), 0.05, (0.0, 0.0, 0.0))
    rng = np.random.default_rng(0)
    clear = 0
    for x, y, dx, dy in np.column_stack([rng.uniform(-0.5, 8.5, (4000, 2)), rng.normal(0, 0.3, (4000, 2))]):
        if region.clearance(found.to_wall, found.frame, x, y) > np.hypot(dx, dy) / 0.05:
            clear += 1
            assert not region.crosses_wall(found.place, found.frame, x, y, x + dx, y + dy)
    assert clear > 500


def test_an_empty_map_has_no_free_cell_and_a_whole_one_no_frontier() -> None:
    assert region.region_of(np.full((9, 9), -1, np.int8), 0.05, (0.0, 0.0, 0.0)).free_xy.size == 0
    closed = np.ones((60, 60), np.int8)
    closed[1:-1, 1:-1] = 0
    assert region.region_of(closed, 0.05, (0.0, 0.0, 0.0)).edge_xy.size == 0
