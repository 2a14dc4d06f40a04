"""Normals of scans and maps."""

import numpy as np
import pytest

from pfcli.core.grid import tiles
from pfcli.core.grid.normals import map_normal, scan_normals
from tests.core.grid.test_scan_match import _points, _scan


def test_normals_are_across_the_walls() -> None:
    ranges = _scan(np.array([4.0, 2.5, 0.0]), np.random.default_rng(0), 0.0)
    points = _points(ranges).ends
    normals = scan_normals(points, 0.3)
    on_wall = np.abs(points[:, 1] + 2.5) < 1e-6
    assert normals[on_wall][:, 2].mean() > 0.9
    clear = on_wall & (normals[:, 2] > 0) & (np.abs(points[:, 0]) > 0.3)
    away = clear & (np.abs(points[:, 0] + 1.0) > 0.3) & (np.abs(points[:, 0]) < 3.5)
    assert np.abs(normals[away][:, 1]).min() > 0.99


def test_a_wide_beam_says_little_of_a_wall_seen_at_grazing_incidence() -> None:
    bearings = np.radians(np.array([80.0, 79.0, 78.0, 12.0, 11.9, 11.8]))
    points = np.stack([1.0 / np.tan(bearings), np.ones(6)], 1)
    normals = scan_normals(points, 0.01 / 0.03)
    assert normals[:, 2].all()
    assert normals[1, 3] == pytest.approx(1 / (1 + (0.01 / 0.03 / np.tan(bearings[1])) ** 2))
    assert normals[4, 3] == pytest.approx(1 / (1 + (0.01 / 0.03 / np.tan(bearings[4])) ** 2))
    assert normals[4, 3] < 0.35 < 0.95 < normals[1, 3]


def _drawn(ends: np.ndarray) -> tiles.Tiles:
    beams = tiles.Beams(np.zeros(2), ends, np.ones(len(ends), np.uint8), np.ones(len(ends)))
    return tiles.draw(tiles.empty(1, 0.05), np.zeros((1, 3)), np.ones(1, bool), beams)


def _normal_at(maps: tiles.Tiles, x: float, y: float) -> tuple[float, float, int]:
    corner = maps.corner * tiles.SIDE
    return map_normal(maps, 0, x / 0.05 - corner[0], y / 0.05 - corner[1])


def test_a_drawn_wall_tells_its_normal_wherever_it_lies() -> None:
    """Within the grain of the drawn surface, 1/254 of a cell, and across borders of tiles."""
    along = np.arange(-2.0, 2.0, 0.02)
    for angle in (0.0, 0.3, 1.2, 2.5):
        direction = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-direction[1], direction[0]])
        maps = _drawn(along[:, None] * direction + 3.0 * across)
        for at in (-1.0, 0.0, 0.7):
            x, y, kind = _normal_at(maps, *(at * direction + 3.0 * across))
            assert kind == 2
            assert abs(x * across[0] + y * across[1]) > np.cos(0.02)


def test_a_corner_and_a_lonely_post_have_none() -> None:
    side = np.arange(0.0, 1.0, 0.02)
    corner = np.concatenate([np.stack([2 + side, np.full(50, 2.0)], 1), np.stack([np.full(50, 2.0), 2 + side], 1)])
    assert _normal_at(_drawn(corner), 2.01, 2.01)[2] == 1
    assert _normal_at(_drawn(np.array([[2.0, 2.0], [2.6, 2.0]])), 2.0, 2.0)[2] == 0
    assert _normal_at(_drawn(corner), 90.0, 90.0)[2] == 0
