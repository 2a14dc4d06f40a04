"""Expected ranges: exact casting against a slow walk, the table against casting, evidence against its definition."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core.grid import raycast
from pfcli.core.sensor import range_beams, range_table
from pfcli.core.sensor.range_beams import Shares

ORIGIN = (-1.0, 2.0, 0.4)


def _map(seed: int, unknown: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((40, 60)) < 0.03, 1, 0).astype(np.int8)
    cells[rng.random(cells.shape) < unknown] = -1
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    return cells


def _slow(cells: np.ndarray, x: float, y: float, turn: float, reach: float) -> float:
    """The nearest entry into the square of any cell that stops a ray, over all of them."""
    ux, uy = np.cos(turn), np.sin(turn)
    best, what = np.inf, 0
    for row, col in np.argwhere(cells != 0):
        with np.errstate(divide="ignore"):
            tx = np.sort(np.array([(col - x), (col + 1 - x)]) / ux)
            ty = np.sort(np.array([(row - y), (row + 1 - y)]) / uy)
        enter, leave = max(tx[0], ty[0], 0.0), min(tx[1], ty[1])
        if enter < leave - 1e-9 and enter < best:
            best, what = enter, cells[row, col]
    return np.inf if best > reach else (best if what == 1 else -1.0)


@given(st.integers(0, 50), st.floats(0.01, 6.27), st.floats(0.05, 0.95), st.floats(0.05, 0.95))
def test_a_ray_ends_where_the_nearest_blocking_cell_begins(seed: int, turn: float, fx: float, fy: float) -> None:
    cells = _map(seed, 0.02)
    free = np.argwhere(cells == 0)
    row, col = free[seed * 17 % len(free)]
    found = raycast.cast_many(
        raycast.clearance(cells), cells, np.array([[col + fx, row + fy]]), np.array([turn]), 1000.0
    )[0]
    expected = _slow(cells, col + fx, row + fy, turn, 1000.0)
    assert found == pytest.approx(expected, abs=1e-6)


def test_a_ray_that_meets_nothing_in_range_says_so() -> None:
    cells = _map(0)
    rays = np.array([[30.5, 20.5]])
    assert raycast.cast_many(raycast.clearance(cells), cells, rays, np.array([0.3]), 0.5)[0] == raycast.NONE


def test_the_table_equals_exact_rays_at_cell_centres_and_bin_directions() -> None:
    cells = _map(3, 0.01)
    table = range_table.build(cells, 0.05, ORIGIN, 72, 4.0)
    room = raycast.clearance(cells)
    for k in range(72):
        exact = raycast.cast_many(
            room, cells, table.centre.astype(float), np.full(len(table.centre), 2 * np.pi * k / 72), 80.0
        )
        value = table.ranges[:, k]
        assert ((value == range_table.UNKNOWN) == (exact < 0)).all()
        assert ((value == range_table.NONE) == np.isinf(exact)).all()
        seen = value < range_table.UNKNOWN
        assert np.abs(value[seen] * table.unit_m - exact[seen] * 0.05).max() <= 0.51 * table.unit_m


def _beams(poses: int, seed: int) -> tuple[np.ndarray, range_beams.Beams]:
    rng = np.random.default_rng(seed)
    xy = rng.uniform([-0.5, 2.6], [0.8, 3.6], (poses, 2))
    mounts = np.array([[0.1, 0.05, 0.3], [-0.1, 0.0, 2.0]])
    ranges = rng.uniform(0.1, 2.0, 12)
    ranges[3] = np.inf
    beams = range_beams.beams_of(mounts, np.array([8, 4]), rng.uniform(-1.5, 1.5, 12), ranges)
    return np.column_stack([xy, rng.uniform(-np.pi, np.pi, poses)]), beams


def _expected(cells: np.ndarray, pose: np.ndarray, beams: range_beams.Beams, b: int) -> float:
    """Exact range (m) of beam b, NONE or UNKNOWN, or NaN where its sensor stands in no free cell."""
    mount = beams.mounts[int(np.searchsorted(beams.start, b, side="right")) - 1]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + c * mount[0] - s * mount[1] - ORIGIN[0], pose[1] + s * mount[0] + c * mount[1] - ORIGIN[1]
    c, s = np.cos(-ORIGIN[2]), np.sin(-ORIGIN[2])
    gx, gy = (c * x - s * y) / 0.05, (s * x + c * y) / 0.05
    if not (0 <= gx < cells.shape[1] and 0 <= gy < cells.shape[0]) or cells[int(gy), int(gx)] != 0:
        return np.nan
    turn = pose[2] + 2 * np.pi * beams.turn[b] - ORIGIN[2]
    r = raycast.cast_many(raycast.clearance(cells), cells, np.array([[gx, gy]]), np.array([turn]), 80.0)[0]
    return r * 0.05 if r >= 0 else r


def test_evidence_of_rays_equals_its_slow_definition() -> None:
    cells = _map(5)
    poses, beams = _beams(60, 1)
    shares = Shares(0.5, 0.2, 0.05)
    model = range_beams.mixture(0.1, shares, 5.0, 0.7, 0.05)
    found = range_beams.from_rays(poses, beams, range_beams.rays_of(cells, 0.05, ORIGIN, 4.0), model)
    checked = 0
    for pose, value in zip(poses, found, strict=True):
        ranges = [_expected(cells, pose, beams, b) for b in range(12)]
        if np.isnan(ranges).any():
            continue
        total = 0.0
        for r, z in zip(ranges, beams.range_m.astype(float), strict=True):
            if np.isinf(z) or np.isinf(r):
                nothing = {(True, True): 0.75, (True, False): 0.05}.get((bool(np.isinf(z)), bool(np.isinf(r))))
                total += np.log(0.45 if nothing is None else nothing / 0.2) if nothing else np.log(0.2 + 0.25)
                continue
            d = z - np.clip(z, r, r + 0.05)
            hit = 0.5 * 5.0 / (0.1 * np.sqrt(2 * np.pi) + 0.1 * (np.floor(1.5 * np.sqrt(0.5)) / 1.5) ** 2)
            total += np.log(hit * np.exp(-0.5 * (d / 0.1) ** 2) + (0.2 if d < 0 else 0.0) + 0.25)
        checked += 1
        # scores are kept in steps of a sixteenth of sigma: 0.06 per beam at the steepest
        assert value == pytest.approx(0.7 * total, abs=0.7 * 12 * 0.06)
    assert checked > 30


def test_the_printed_gaussian_is_minus_half_the_squared_distance_in_sigmas() -> None:
    cells = _map(6)
    poses, beams = _beams(40, 2)
    beams = beams._replace(range_m=np.where(np.isinf(beams.range_m), np.float32(1.0), beams.range_m))
    found = range_beams.from_rays(
        poses, beams, range_beams.rays_of(cells, 0.05, ORIGIN, 4.0), range_beams.gaussian(0.5)
    )
    for pose, value in zip(poses, found, strict=True):
        ranges = np.array([_expected(cells, pose, beams, b) for b in range(12)])
        if np.isnan(ranges).any() or np.isinf(ranges).any():
            continue
        assert value == pytest.approx(-0.5 * np.sum(((beams.range_m - ranges) / 0.5) ** 2), rel=0.1, abs=0.5)


def test_table_and_rays_agree_on_where_the_robot_is() -> None:
    from pfcli.simulation.indoor_world import WORLDS, rasterize

    grid = rasterize(WORLDS["four-rooms"](1), 0.05)
    rng = np.random.default_rng(3)
    poses = np.column_stack([rng.uniform([0.5, 4.3], [11.0, 5.7], (4000, 2)), rng.uniform(-3, 3, 4000)])
    beams = range_beams.beams_of(np.zeros((1, 3)), np.array([60]), np.linspace(-2, 2, 60), rng.uniform(0.3, 5.0, 60))
    model = range_beams.mixture(0.2, Shares(0.5, 0.2, 0.05), 5.0, 1.0, 0.05)
    table = range_beams.from_table(
        poses, beams, range_table.build(grid.cells, 0.05, tuple(grid.origin), 720, 15.0), model
    )
    rays = range_beams.from_rays(poses, beams, range_beams.rays_of(grid.cells, 0.05, tuple(grid.origin), 15.0), model)
    assert np.corrcoef(table, rays)[0, 1] > 0.95
    assert np.abs(np.mean(table - rays)) < 0.1 * np.std(rays)


def test_looked_up_ranges_are_as_near_to_exact_ones_as_promised() -> None:
    from pfcli.simulation.indoor_world import WORLDS, rasterize

    grid = rasterize(WORLDS["four-rooms"](1), 0.05)
    table = range_table.build(grid.cells, 0.05, tuple(grid.origin), 360, 30.0)
    one, two = range_table.deviation(table, grid.cells, 0.05, 50_000)
    assert one >= 0.90
    assert two >= 0.96


def test_a_sensor_in_an_occupied_cell_is_served_by_the_free_one_beside_it() -> None:
    cells = np.zeros((40, 40), np.int8)
    cells[20, 20] = 1
    cells[0:3, :] = 1
    table = range_table.build(cells, 0.1, (0.0, 0.0, 0.0), 72, 5.0)
    assert table.row[20, 20] in (table.row[20, 19], table.row[20, 21], table.row[19, 20], table.row[21, 20])
    assert (table.row[cells == 0] >= 0).all()


def test_walls_are_as_thick_as_they_are_drawn() -> None:
    thin, thick = np.zeros((50, 50), np.int8), np.zeros((50, 50), np.int8)
    thin[25] = 1
    thick[24:28] = 1
    assert raycast.wall_thickness_m(thin, 0.1) == pytest.approx(0.1)
    assert raycast.wall_thickness_m(thick, 0.1) == pytest.approx(0.4)
    assert raycast.wall_thickness_m(np.zeros((5, 5), np.int8), 0.1) == pytest.approx(0.1)


def test_unknown_specks_are_looked_through_and_unknown_rooms_are_not() -> None:
    cells = np.full((80, 80), -1, np.int8)
    cells[10:70, 10:70] = 0
    cells[10:70, 69] = 1
    cells[30:50, 30:50] = -1  # a square metre
    cells[15:17, 12:60] = -1  # a gap of 0.1 m
    seen = raycast.unveiled(cells, 0.05, 0.3)
    assert (seen[15:17, 12:60] == 0).all()
    assert (seen[35:45, 35:45] == -1).all()
    assert (seen[30:40, 70:75] == 0).all()
    assert (seen[:, 78:] == -1).all()
    assert (seen[cells != -1] == cells[cells != -1]).all()
    assert (raycast.unveiled(cells, 0.05, 0.0) == cells).all()
