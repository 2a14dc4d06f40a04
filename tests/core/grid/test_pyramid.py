"""Branch and bound finds what looking everywhere finds."""

import numpy as np
import pytest

from pfcli.core.grid.pyramid import Pyramid, Region, build, search


def _walls(rng: np.random.Generator) -> np.ndarray:
    """Points of a few walls of a room of 12 x 9 m, none of them alike."""
    ends = rng.uniform((0, 0, 0, 0), (12, 9, 12, 9), (7, 4))
    return np.concatenate([np.linspace(e[:2], e[2:], 80) for e in ends])


def _everywhere(pyramid: Pyramid, points: np.ndarray, region: Region, yaws: np.ndarray) -> float:
    """The best mean likelihood of all cells and headings of the region (the oracle)."""
    grid, best = pyramid.levels[0].astype(np.int64), -1
    rows, cols = grid.shape
    n = int(np.ceil(region.half_xy_m / pyramid.cell_m))
    for yaw in yaws:
        x = region.middle[0] + np.cos(yaw) * points[:, 0] - np.sin(yaw) * points[:, 1]
        y = region.middle[1] + np.sin(yaw) * points[:, 0] + np.cos(yaw) * points[:, 1]
        c = np.floor((x - pyramid.corner[0]) / pyramid.cell_m).astype(int)
        r = np.floor((y - pyramid.corner[1]) / pyramid.cell_m).astype(int)
        for dy in range(-n, n + 1):
            for dx in range(-n, n + 1):
                at, to = r + dy, c + dx
                inside = (at >= 0) & (at < rows) & (to >= 0) & (to < cols)
                best = max(best, int(grid[at[inside], to[inside]].sum()))
    return best / (255.0 * len(points))


@pytest.mark.parametrize("seed", range(4))
def test_the_best_of_all_places_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    walls = _walls(rng)
    pose = np.array([*rng.uniform((3, 3), (8, 6)), rng.uniform(-0.2, 0.2)])
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    points = ((walls[::9] - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])) + rng.normal(0, 0.02, (len(walls[::9]), 2))
    pyramid = build(walls, 0.15, 0.1)
    region = Region(pose + np.array([0.9, -0.7, 0.1]), 1.6, 0.25)
    found = search(pyramid, points, region, 0.3)
    reach = np.quantile(np.hypot(*points.T), 0.9)
    half = int(np.ceil(0.25 / (0.15 / reach)))
    yaws = region.middle[2] + np.arange(-half, half + 1) * 0.15 / reach
    # the search covers the cells of the region's squares, the oracle those of the region
    assert found.score >= _everywhere(pyramid, points, region, yaws) - 1e-12
    assert np.hypot(*(found.pose - pose)[:2]) < 0.15
    assert abs(found.pose[2] - pose[2]) < 0.03


def test_a_rival_is_looked_for_elsewhere_and_nothing_below_the_least() -> None:
    """Two equal rooms: the second is found beside the first; a bar that no place reaches finds none."""
    room = np.concatenate(
        [np.linspace((0, 0), (3, 0), 60), np.linspace((0, 0), (0, 2), 40), np.linspace((3, 0), (3, 2), 40)]
    )
    pyramid = build(np.concatenate([room, room + np.array([6.0, 0.0])]), 0.15, 0.1)
    region = Region(np.array([3.0, 0.0, 0.0]), 5.0, 0.1)
    first = search(pyramid, room, region, 0.5)
    second = search(pyramid, room, region, 0.5, first)
    assert sorted(round(float(p.pose[0])) for p in (first, second)) == [0, 6]
    assert second.score > 0.9
    assert search(pyramid, room + np.array([0.0, 40.0]), Region(np.zeros(3), 1.0, 0.1), 0.5).score == -1.0
