"""Copy-on-write tiles against dense arrays, and their bookkeeping."""

import numpy as np
import pytest

from pfcli.core.grid import tiles
from pfcli.core.grid.scan_points import beams_of, points_of


def _insert(maps: tiles.Tiles, poses: np.ndarray, ranges: np.ndarray) -> tiles.Tiles:
    n = ranges.size
    points = points_of(ranges, (-np.pi, 2 * np.pi / n), (0.0, 50.0), (0.0, 0.0, 0.0), 1, 0.0, maps.resolution_m)
    beams = beams_of(points, (0.0, 0.0, 0.0))
    reach = ranges.max() + 1
    maps = tiles.cover(maps, poses[:, :2].min(axis=0) - reach, poses[:, :2].max(axis=0) + reach)
    maps = tiles.own(maps, tiles.touch(maps, poses, beams))
    tiles.insert(maps, poses, np.ones(len(poses), bool), beams)
    return maps


def _held(maps: tiles.Tiles) -> np.ndarray:
    counts = np.zeros(maps.refs.size, int)
    np.add.at(counts, maps.index[maps.index >= 0], 1)
    return counts


def test_a_round_room_is_a_ring_of_occupied_cells_around_free_ones() -> None:
    maps = _insert(tiles.empty(1, 0.05), np.zeros((1, 3)), np.full(720, 2.0))
    cells = tiles.classify(maps, 0)
    rows, cols = np.nonzero(cells == 1)
    corner = maps.corner * tiles.SIDE
    x, y = (cols + corner[0] + 0.5) * 0.05, (rows + corner[1] + 0.5) * 0.05
    assert np.abs(np.hypot(x, y) - 2.0).max() < 0.05
    rows, cols = np.nonzero(cells == 0)
    r = np.hypot((cols + corner[0] + 0.5) * 0.05, (rows + corner[1] + 0.5) * 0.05)
    assert r.max() < 2.05
    assert (r < 1.9).sum() > 0.97 * np.pi * 1.9**2 / 0.05**2


def test_every_touched_cell_lies_in_a_tile_that_was_marked() -> None:
    """`insert` writes without looking; were a tile missing, its index -1 would hit another tile."""
    rng = np.random.default_rng(5)
    for _ in range(40):
        poses = np.column_stack([rng.uniform(-3, 3, (4, 2)), rng.uniform(-3, 3, 4)])
        maps = _insert(tiles.empty(4, 0.05), poses, rng.uniform(0.1, 12, 300))
        visited = (maps.counts & 255).sum(axis=1) > 0
        assert (_held(maps)[visited] == 1).all()
        free = maps.free[: maps.top[0]]
        assert maps.index.max() < maps.refs.size
        assert not np.isin(maps.index[maps.index >= 0], free).any()


def test_reference_counts_are_what_the_tables_hold() -> None:
    rng = np.random.default_rng(6)
    maps = tiles.empty(6, 0.1, capacity=4)
    for _ in range(15):
        poses = np.column_stack([rng.uniform(-8, 8, (6, 2)), rng.uniform(-3, 3, 6)])
        maps = _insert(maps, poses, rng.uniform(0.5, 6, 90))
        maps = tiles.resample(maps, rng.integers(0, 6, 6))
        assert (_held(maps) == maps.refs).all()
        assert tiles.used(maps) == (maps.refs > 0).sum()


def test_offspring_share_tiles_until_they_draw() -> None:
    maps = _insert(tiles.empty(3, 0.05), np.zeros((3, 3)), np.full(360, 3.0))
    alone = tiles.used(maps) // 3
    maps = tiles.resample(maps, np.array([1, 1, 1]))
    assert tiles.used(maps) == alone
    before = tiles.classify(maps, 0).copy()
    poses = np.zeros((3, 3))
    maps = tiles.own(maps, tiles.touch(maps, poses, _beams(2.0)))
    assert tiles.used(maps) > alone
    assert (tiles.classify(maps, 0) == before).all()


def _beams(r: float) -> tiles.Beams:
    points = points_of(np.full(4, r), (0.0, np.pi / 2), (0.0, 50.0), (0.0, 0.0, 0.0), 1, 0.0, 0.05)
    return beams_of(points, (0.0, 0.0, 0.0))


def test_nearest_offsets_equal_a_brute_force_distance_transform() -> None:
    rng = np.random.default_rng(7)
    maps = _insert(tiles.empty(1, 0.05), np.array([[0.3, -0.2, 0.4]]), rng.uniform(0.5, 4, 200))
    cells = tiles.classify(maps, 0)
    occupied = np.argwhere(cells == 1)
    for tile_row, tile_col in np.argwhere(maps.index[0] >= 0):
        tile = maps.index[0, tile_row, tile_col]
        for k in range(0, tiles.CELLS, 7):
            row, col = tile_row * tiles.SIDE + k // tiles.SIDE, tile_col * tiles.SIDE + k % tiles.SIDE
            best = ((occupied - (row, col)) ** 2).sum(axis=1).min()
            if maps.surface[tile, k, 0] == tiles.NONE:
                assert best > tiles.REACH**2
            else:
                offset = maps.surface[tile, k, :2].astype(int) - tiles.REACH
                assert (offset**2).sum() == best
                assert ((row + offset[1], col + offset[0]) == occupied).all(axis=1).any()


def test_a_door_that_opens_becomes_free() -> None:
    pose = np.zeros((1, 3))
    maps = tiles.empty(1, 0.05)
    for _ in range(3):
        maps = _insert(maps, pose, np.full(360, 2.0))
    for _ in range(40):
        maps = _insert(maps, pose, np.full(360, 5.0))
    cells = tiles.classify(maps, 0)
    rows, cols = np.nonzero(cells == 1)
    corner = maps.corner * tiles.SIDE
    r = np.hypot((cols + corner[0] + 0.5) * 0.05, (rows + corner[1] + 0.5) * 0.05)
    assert r.min() > 4.9


def test_counts_saturate_without_losing_the_wall() -> None:
    pose = np.zeros((1, 3))
    maps = tiles.empty(1, 0.05)
    for _ in range(600):
        maps = _insert(maps, pose, np.full(90, 2.0))
    assert (maps.counts & 255).max() <= 254
    assert (tiles.classify(maps, 0) == 1).sum() > 60


@pytest.mark.parametrize("shift", [0.0, 1e5])
def test_memory_follows_the_mapped_area_not_the_coordinates(shift: float) -> None:
    maps = tiles.empty(1, 0.05)._replace(corner=np.floor(np.full(2, shift) / 1.6).astype(np.int64) - 8)
    maps = _insert(maps, np.array([[shift, shift, 0.0]]), np.full(360, 3.0))
    assert tiles.used(maps) <= 36
