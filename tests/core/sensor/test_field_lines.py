"""Field lines: the table against every line looked at, evidence, and poses refined on the lines."""

import math

import numpy as np
import pytest

from pfcli.core.geometry import compose
from pfcli.core.sensor import field_lines
from pfcli.formats import field_yaml

FIELD = field_yaml.read("msl-18x12")
TABLE = field_lines.build(FIELD.lines)
SIGMA = np.linspace(0.05, 0.3, field_lines.RANGES)


def seen(pose: np.ndarray, count: int, noise_m: float, rng: np.random.Generator) -> np.ndarray:
    """Points (2, count) of lines within 6 m of the pose, in its frame."""
    marks = field_lines.samples(FIELD.lines)
    near = marks[np.hypot(*(marks - pose[:2]).T) < 6.0]
    chosen = near[rng.choice(near.shape[0], count)]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    d = chosen - pose[:2]
    local = np.column_stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]])
    return np.ascontiguousarray((local + noise_m * rng.standard_normal(local.shape)).T, np.float32)


def distance(x: float, y: float) -> float:
    """To the nearest line, by dense samples of each."""
    best = math.inf
    for x1, y1, x2, y2 in FIELD.lines.segments:
        t = np.linspace(0, 1, 4001)
        best = min(best, float(np.hypot(x1 + t * (x2 - x1) - x, y1 + t * (y2 - y1) - y).min()))
    for cx, cy, r, start, stop in FIELD.lines.arcs:
        a = np.linspace(start, stop, 4001)
        best = min(best, float(np.hypot(cx + r * np.cos(a) - x, cy + r * np.sin(a) - y).min()))
    return best


def test_the_nearest_line_is_the_nearest() -> None:
    rng = np.random.default_rng(0)
    for x, y in rng.uniform((-10, -7), (10, 7), (40, 2)):
        found, _ = field_lines.nearest_line(FIELD.lines.segments, FIELD.lines.arcs, x, y)
        assert found == pytest.approx(distance(x, y), abs=5e-3)


def test_the_table_is_off_by_a_cell_and_a_step_at_the_most() -> None:
    rng = np.random.default_rng(1)
    steps = TABLE.steps.reshape(TABLE.rows, TABLE.cols)
    for x, y in rng.uniform((-11, -8), (11, 8), (300, 2)):
        row, col = (int((v - low) / field_lines.CELL_M) for v, low in ((y, TABLE.low[1]), (x, TABLE.low[0])))
        exact, _ = field_lines.nearest_line(FIELD.lines.segments, FIELD.lines.arcs, x, y)
        exact = min(exact, (field_lines.STEPS - 1) * field_lines.STEP_M)
        allowed = field_lines.CELL_M / math.sqrt(2) + field_lines.STEP_M / 2
        assert abs(steps[row, col] * field_lines.STEP_M - exact) <= allowed + 1e-9


def test_evidence_by_table_is_that_without_but_for_the_cells() -> None:
    rng = np.random.default_rng(2)
    pose = np.array([2.0, -1.0, 0.7])
    points = seen(pose, 100, 0.05, rng)
    values = field_lines.evidence_table(SIGMA, 0.8, 1.0)
    poses = pose + rng.normal(0, (0.2, 0.2, 0.1), (200, 3))
    table = field_lines.evidence(poses, points, TABLE, values)
    sigma = SIGMA[field_lines.range_bins(points)]
    exact = field_lines.evidence_exact(poses, points, FIELD.lines, sigma, 0.8, 1.0)
    # a cell's error is even and independent from point to point: per point it averages out
    assert np.abs(table - exact).max() / 100 < 0.02
    assert np.corrcoef(table, exact)[0, 1] > 0.999


def test_poses_are_refined_to_where_the_points_came_from() -> None:
    """Three hundred starts off by 0.2 m and 0.1 rad, as in data/README.md, whose error minimisation has mean 0.031 m."""
    rng, off = np.random.default_rng(3), []
    for _ in range(100):
        pose = np.array([*rng.uniform((-8, -5), (8, 5)), rng.uniform(-3, 3)])
        points = seen(pose, 100, 0.1, rng)
        sigma = np.full(100, 0.1)
        start = pose + rng.normal(0, (0.14, 0.14, 0.1))
        found, hessian = field_lines.refine(start[None], points, sigma, TABLE, FIELD.lines, 1.0)
        off.append(np.hypot(*(found[0] - pose)[:2]))
        assert np.linalg.eigvalsh(hessian[0]).min() > 0.0
    assert np.median(off) < 0.03
    assert np.quantile(off, 0.95) < 0.1


def test_the_hessian_says_how_far_off_refined_poses_are() -> None:
    """Normalised squared errors of refined poses average 3: between 1.5 and 6, for the robust cost is not exactly Gaussian."""
    rng, squares = np.random.default_rng(4), []
    pose = np.array([3.0, 1.0, 0.4])
    for _ in range(200):
        points = seen(pose, 100, 0.1, rng)
        found, hessian = field_lines.refine(pose[None], points, np.full(100, 0.1), TABLE, FIELD.lines, 1.0)
        e = found[0] - pose
        squares.append(e @ hessian[0] @ e)
    assert 1.5 < np.mean(squares) < 6.0


def test_lines_that_ought_to_be_seen_speak_for_the_right_pose() -> None:
    rng = np.random.default_rng(5)
    pose = np.array([-4.0, 2.0, 1.0])
    points = seen(pose, 300, 0.05, rng)
    view = field_lines.seen_from(points.T.astype(float), 6.0)
    poses = np.vstack(
        [pose, np.column_stack([rng.uniform(-9, 9, 200), rng.uniform(-6, 6, 200), rng.uniform(-3, 3, 200)])]
    )
    found = field_lines.evidence_of_missed(poses, field_lines.samples(FIELD.lines), view, 0.3)
    assert np.argmax(found) == 0


def test_the_mirror_pose_sees_the_same_lines() -> None:
    rng = np.random.default_rng(6)
    pose = np.array([[2.0, -1.0, 0.7]])
    points = seen(pose[0], 100, 0.05, rng)
    mirrored = compose(np.array([[0.0, 0.0, math.pi]]), pose)
    values = field_lines.evidence_table(SIGMA, 0.8, 1.0)
    own, other = field_lines.evidence(np.vstack([pose, mirrored]), points, TABLE, values)
    assert own == pytest.approx(other, abs=1.0)
