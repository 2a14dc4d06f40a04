"""The matcher against exact scenes and a slow oracle."""

import itertools

import numpy as np
import pytest

from pfcli.core.geometry import compose
from pfcli.core.grid import coarse_search, scan_match, tiles
from pfcli.core.grid.normals import scan_normals
from pfcli.core.grid.scan_points import Points, beams_of, points_of
from pfcli.simulation.laser import cast

WALLS = np.array(
    [
        [0, 0, 8, 0], [8, 0, 8, 5], [8, 5, 0, 5], [0, 5, 0, 0],
        [3, 0, 3, 1.5], [5, 5, 5, 3.5], [6, 2, 6.8, 2.6], [1.2, 3.4, 2.0, 3.9],
    ],
    float,
)  # fmt: skip
ANGLES = np.radians(np.linspace(-135, 135, 271))


def _scan(pose: np.ndarray, rng: np.random.Generator, noise: float = 0.005) -> np.ndarray:
    out = np.empty(ANGLES.size)
    cast(pose[0], pose[1], ANGLES + pose[2], WALLS, np.zeros((0, 3)), 30.0, out)
    return out + noise * rng.standard_normal(out.size)


def _points(ranges: np.ndarray) -> np.ndarray:
    step = ANGLES[1] - ANGLES[0]
    return points_of(ranges, (ANGLES[0], step), (0.0, 29.0), (0.0, 0.0, 0.0), 1, 0.0, 0.05)


@pytest.fixture(scope="module")
def room() -> tiles.Tiles:
    rng = np.random.default_rng(0)
    maps = tiles.cover(tiles.empty(1, 0.05), np.array([-3.0, -3.0]), np.array([11.0, 8.0]))
    for x, y, yaw in (
        (2, 2, 0.0),
        (2.2, 2.1, 0.4),
        (4, 3, 1.0),
        (4.2, 2.5, 2.6),
        (6.5, 3.6, -2.0),
        (7, 1, -0.7),
        (1, 1, 1.5),
    ):
        pose = np.array([[x, y, yaw]])
        beams = beams_of(_points(_scan(pose[0], rng)), (0.0, 0.0, 0.0))
        maps = tiles.draw(maps, pose, np.ones(1, bool), beams)
    return maps


def _match(room: tiles.Tiles, prior: np.ndarray, points: np.ndarray, sd: tuple[float, float]) -> scan_match.Match:
    information = np.diag([sd[0] ** -2, sd[0] ** -2, sd[1] ** -2])
    window = coarse_search.Window(0.3, 0.35, 0.15, 0.035, 0.12, 55, 0.005)
    offered = coarse_search.coarse(room, 0, prior, points[::5].copy(), window)
    return scan_match.match(room, prior[None], information, offered[None], points, scan_match.Matcher())


def test_a_match_is_sub_cell_accurate(room: tiles.Tiles) -> None:
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(30):
        true = np.array([rng.uniform(3.2, 4.8), rng.uniform(1.8, 3.2), rng.uniform(-3, 3)])
        prior = true + rng.normal(0, [0.05, 0.05, 0.05])
        found = _match(room, prior, _points(_scan(true, rng)).ends, (0.1, 0.1)).pose[0]
        errors.append(np.abs(found - true))
    assert np.median(errors, axis=0)[:2].max() < 0.01  # a fifth of a cell
    assert np.median(errors, axis=0)[2] < np.radians(0.25)


def test_a_slip_of_0_3_m_and_15_degrees_is_recovered(room: tiles.Tiles) -> None:
    rng = np.random.default_rng(2)
    good = 0
    for k in range(40):
        true = np.array([rng.uniform(3.2, 4.8), rng.uniform(1.8, 3.2), rng.uniform(-3, 3)])
        away = 2 * np.pi * k / 40
        slip = np.array([[0.3 * np.cos(away), 0.3 * np.sin(away), np.radians(15) * (-1) ** k]])
        prior = compose(true[None], slip)[0]
        found = _match(room, prior, _points(_scan(true, rng)).ends, (0.05, 0.03)).pose[0]
        good += np.hypot(*(found - true)[:2]) < 0.03 and abs(found[2] - true[2]) < np.radians(1)
    assert good >= 38


def test_along_a_corridor_the_odometry_decides() -> None:
    """Two parallel walls say nothing about the way along them: the prior must not be given up for noise."""
    walls = np.array([[-20, -1, 20, -1], [-20, 1, 20, 1]], float)
    rng = np.random.default_rng(3)
    ranges = np.empty(ANGLES.size)
    maps = tiles.cover(tiles.empty(1, 0.05), np.array([-30.0, -5]), np.array([30.0, 5]))
    for x in np.arange(-4, 4, 0.37):
        cast(x, 0.0, ANGLES, walls, np.zeros((0, 3)), 6.0, ranges)
        points = points_of(ranges, (ANGLES[0], ANGLES[1] - ANGLES[0]), (0.0, 5.9), (0.0, 0.0, 0.0), 1, 0.0, 0.05)
        beams, pose = beams_of(points, (0.0, 0.0, 0.0)), np.array([[x, 0.0, 0.0]])
        maps = tiles.draw(maps, pose, np.ones(1, bool), beams)
    cast(0.11, 0.02, ANGLES, walls, np.zeros((0, 3)), 6.0, ranges)
    noisy = ranges + 0.005 * rng.standard_normal(ranges.size)
    points = points_of(noisy, (ANGLES[0], ANGLES[1] - ANGLES[0]), (0.0, 5.9), (0.0, 0.0, 0.0), 1, 0.0, 0.05)
    prior = np.array([0.11, 0.0, 0.01])
    m = scan_match.match(
        maps,
        prior[None],
        np.diag([1 / 0.02**2, 1 / 0.02**2, 1 / 0.02**2]),
        np.zeros((1, 3)),
        points.ends,
        scan_match.Matcher(),
    )
    assert m.pose[0] == pytest.approx([0.11, 0.02, 0.0], abs=0.012)
    covariance = np.linalg.inv(m.information[0])
    assert covariance[0, 0] > 4 * covariance[1, 1]


def test_log_likelihood_equals_its_five_line_definition(room: tiles.Tiles) -> None:
    m = scan_match.Matcher()
    rng = np.random.default_rng(4)
    pose = np.array([4.1, 2.4, 0.3])
    points = _points(_scan(pose, rng)).ends
    normals = scan_normals(points, 0.3)
    total = 0.0
    for (px, py), (nx, ny, line, weight) in zip(points, normals, strict=True):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        w = np.array([pose[0] + c * px - s * py, pose[1] + s * px + c * py])
        g = w / 0.05 - room.corner * tiles.SIDE
        state, mx, my = tiles.nearest_surface(room, 0, g[0], g[1])
        if state < 2:
            total += np.log(m.z_unknown if state == 0 else m.z_rand)
            continue
        e = (np.array([mx, my]) + room.corner * tiles.SIDE) * 0.05 - w
        n = np.array([c * nx - s * ny, s * nx + c * ny]) if line else np.array([1.0, 0.0])
        along = m.tangent if line else 1.0
        r2 = (n @ e) ** 2 + along * (n[0] * e[1] - n[1] * e[0]) ** 2
        total += np.log((1 - m.z_rand) * np.exp(-0.5 * weight * r2 / m.sigma_m**2) + m.z_rand)
    assert scan_match.log_likelihood(room, 0, pose, points, normals, m.sigma_m, m, 1) == pytest.approx(m.gain * total)


def test_a_scan_on_unknown_map_keeps_the_odometry() -> None:
    maps = tiles.cover(tiles.empty(2, 0.05), np.array([-9.0, -9.0]), np.array([9.0, 9.0]))
    prior = np.array([[0.5, 0.1, 0.2], [0.0, 0.0, 0.0]])
    points = _points(np.full(ANGLES.size, 3.0)).ends
    m = scan_match.match(maps, prior, np.eye(3) * 100, np.zeros((2, 3)), points, scan_match.Matcher())
    assert m.pose == pytest.approx(prior)
    assert (m.inliers == -1).all()


def test_a_search_that_gives_poses_up_early_finds_what_one_without_does(room: tiles.Tiles) -> None:
    rng = np.random.default_rng(8)
    window = coarse_search.Window(0.3, 0.35, 0.15, 0.035, 0.12, 55, 0.005)
    table = coarse_search._likelihoods(room.resolution_m / window.sigma_m)
    found = 0
    for count in (0, 1, 7, 8, 9, 50, 50, 50, 50):
        true = np.array([rng.uniform(3.2, 4.8), rng.uniform(1.8, 3.2), rng.uniform(-3, 3)])
        start = true + rng.normal(0, [0.15, 0.15, 0.15])
        points = _points(_scan(true, rng)).ends[:: 271 // max(1, count)][:count].copy()
        rotated = np.empty(points.shape)
        coarse_search._turned(points, start[2], 20.0, rotated)
        before = coarse_search._coarse_score(room, 0, start[0], start[1], rotated, table, -1.0)
        best, expected = before + 0.005, np.zeros(3)
        for a in range(-10, 11):
            coarse_search._turned(points, start[2] + 0.035 * a, 20.0, rotated)
            for dx, dy in itertools.product(0.15 * np.arange(-2, 3), repeat=2):
                c, s = np.cos(start[2]), np.sin(start[2])
                x, y = start[0] + c * dx - s * dy, start[1] + s * dx + c * dy
                penalty = 0.03 * ((dx * dx + dy * dy) / (2 * 0.3**2) + (0.035 * a / 0.35) ** 2)
                score = coarse_search._coarse_score(room, 0, x, y, rotated, table, -1.0) - penalty
                if score > best:
                    best, expected = score, np.array([dx, dy, 0.035 * a])
        assert coarse_search.coarse(room, 0, start, points, window) == pytest.approx(expected)
        found += expected.any()
    assert found >= 4


def test_a_second_start_near_the_first_changes_nothing(room: tiles.Tiles) -> None:
    rng = np.random.default_rng(9)
    true = np.array([4.0, 2.5, 0.7])
    points, prior = _points(_scan(true, rng)).ends, true + np.array([0.03, -0.02, 0.02])
    once, twice = (
        scan_match.match(room, prior[None], np.eye(3) * 100, offered[None], points, scan_match.Matcher())
        for offered in (np.zeros(3), np.array([0.05, 0.05, 0.0]))
    )
    assert np.abs(once.pose - twice.pose).max() < 3e-3


def test_where_the_map_ends_does_not_pull_along_a_corridor() -> None:
    """Against all that was seen from 10 m of a plain corridor, 2 cm of noise: the far end points lie beyond what is drawn."""
    rng, bearings = np.random.default_rng(5), np.radians(np.arange(-90.0, 90.5))
    walls = np.array([[-100.0, -1.2, 100.0, -1.2], [-100.0, 1.3, 100.0, 1.3]])
    seen = np.empty(bearings.size)

    def points(x: float) -> Points:
        cast(x, 0.0, bearings, walls, np.zeros((0, 3)), 80.0, seen)
        ranges = seen + 0.02 * rng.standard_normal(seen.size)
        return points_of(ranges, (bearings[0], bearings[1] - bearings[0]), (0.0, 40.0), (0.0, 0.0, 0.0), 1, 0.0, 0.05)

    information, off = np.diag([0.07**-2, 0.07**-2, 0.03**-2]), {}
    for name, m in (("scan", scan_match.Matcher()), ("map", scan_match.Matcher(map_normals=True, tangent=0.0))):
        maps, slid = tiles.empty(1, 0.05), []
        for k in range(41):
            pose, scan = np.array([[0.25 * k, 0.0, 0.0]]), points(0.25 * k)
            if k > 10:
                found = scan_match.match(maps, pose, information, np.zeros((1, 3)), scan.ends, m)
                slid.append(found.pose[0, 0] - pose[0, 0])
            maps = tiles.draw(maps, pose, np.ones(1, bool), beams_of(scan, (0.0, 0.0, 0.0)))
        off[name] = np.mean(slid), np.std(slid) / np.sqrt(len(slid))
    assert abs(off["map"][0]) < 4 * off["map"][1] + 1e-4
    assert abs(off["scan"][0]) > 4 * off["scan"][1]


def test_known_share_counts_end_points_on_drawn_map(room: tiles.Tiles) -> None:
    here, outside = np.array([4.0, 2.5, 0.3]), np.array([100.0, 100.0, 0.0])
    points = _points(_scan(here, np.random.default_rng(0))).ends
    assert scan_match.known_share(room, 0, here, points) == 1.0
    assert scan_match.known_share(room, 0, outside, points) == 0.0
