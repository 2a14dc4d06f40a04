import numpy as np
import pytest

from pfcli.core.sensor import likelihood_field as lf

MODEL = lf.Model(0.1, 0.8, 5.0)


def _map(rng: np.random.Generator) -> np.ndarray:
    cells = np.zeros((60, 90), np.int8)
    cells[rng.random(cells.shape) < 0.03] = 1
    cells[:, 60:] = -1
    return cells


def _slow(pose: np.ndarray, points: np.ndarray, cells: np.ndarray, origin: tuple[float, float, float]) -> float:
    """The definition: distance to the nearest occupied cell's centre, cell by cell; unknown cells are left out."""
    occupied = np.argwhere(cells == 1)
    total = 0.0
    for px, py in points.T.astype(float):
        wx = pose[0] + np.cos(pose[2]) * px - np.sin(pose[2]) * py - origin[0]
        wy = pose[1] + np.sin(pose[2]) * px + np.cos(pose[2]) * py - origin[1]
        col = int(np.floor((np.cos(origin[2]) * wx + np.sin(origin[2]) * wy) / 0.05))
        row = int(np.floor((-np.sin(origin[2]) * wx + np.cos(origin[2]) * wy) / 0.05))
        if not (0 <= row < cells.shape[0] and 0 <= col < cells.shape[1]):
            continue
        d = 0.05 * np.sqrt(((occupied - (row, col)) ** 2).sum(axis=1).min())
        peak = 5.0 / (0.1 * np.sqrt(2 * np.pi))
        value = np.log(0.8 * peak * np.exp(-0.5 * (d / 0.1) ** 2) + 0.2)
        total += 0.0 if cells[row, col] == -1 and value < 0 else value
    return total


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (-1.0, 2.0, 0.0), (0.5, -0.3, 0.7)])
def test_evidence_equals_its_slow_definition(origin: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(3)
    cells = _map(rng)
    field = lf.build(cells, 0.05, origin, MODEL, unknown=True)
    points = rng.uniform(-1.5, 1.5, (2, 40)).astype(np.float32)
    n = lf._BLOCK + 44
    local = np.stack([rng.uniform(0.5, 4.0, n), rng.uniform(0.5, 2.5, n)])
    c, s = np.cos(origin[2]), np.sin(origin[2])
    xy = np.array(origin[:2])[:, None] + np.array([[c, -s], [s, c]]) @ local
    poses = np.column_stack([*xy, rng.uniform(-3, 3, n)])
    fast = lf.evidence(poses, points, field)
    cut = [lf.evidence(part, points, field) for part in np.split(poses, [13, lf._BLOCK + 1])]
    assert np.concatenate(cut).tobytes() == fast.tobytes()
    slow = np.array([_slow(p, points, cells, origin) for p in poses])
    # in single precision a beam that ends on the edge of a cell may fall into the next one: one beam in some hundreds
    assert np.mean(np.abs(fast - slow) < 1e-3) > 0.9
    assert np.abs(fast - slow).max() < 4.2


def test_what_is_no_number_is_off_the_map_and_the_top_is_the_highest_value() -> None:
    cells = np.zeros((40, 40), np.int8)
    cells[:, 30] = 1
    field = lf.build(cells, 0.05, (0.0, 0.0, 0.0), MODEL, unknown=False)
    outside = lf.evidence(np.array([[-50.0, 1.0, 0.0]]), np.zeros((2, 1), np.float32), field)
    far = lf.evidence(np.array([[1.0, 1.0, 0.3]]), np.full((2, 1), 3e38, np.float32), field)
    nowhere = lf.evidence(np.array([[np.nan, 1.0, 0.0], [1.0, 1.0, np.nan]]), np.zeros((2, 1), np.float32), field)
    assert far == outside
    assert nowhere[0] == outside
    assert field.top == pytest.approx(field.table.reshape(lf.LEVELS, -1).max(axis=1))


def test_a_base_is_subtracted_where_the_map_explains_and_never_turns_an_argument_against_into_one_for() -> None:
    cells = np.zeros((40, 40), np.int8)
    cells[:, 30] = 1
    field = lf.build(cells, 0.05, (0.0, 0.0, 0.0), MODEL, unknown=True)
    pose = np.array([[1.0, 1.0, 0.0]])
    hit, miss = np.array([[0.52], [0.0]], np.float32), np.array([[-0.5], [0.0]], np.float32)
    top, floor = lf.log_ratio(np.array([0.0, np.inf]), MODEL)
    assert lf.evidence(pose, hit, field)[0] == pytest.approx(top, abs=1e-5)
    assert lf.evidence(pose, miss, field)[0] == pytest.approx(floor, abs=1e-5)
    base = np.array([[2.0], [1.0]], np.float32)
    assert lf.evidence(pose, hit, field, None, base)[0] == pytest.approx(top - 2.0, abs=1e-5)
    assert lf.evidence(pose, miss, field, None, base)[0] == pytest.approx(floor - 1.0, abs=1e-5)
    assert lf.evidence(pose, miss, field, None, np.array([[0.0], [2 * floor]], np.float32))[0] == 0.0
    more = np.array([[top + 1.0], [0.0]], np.float32)
    assert lf.evidence(pose, hit, field, None, more)[0] == pytest.approx(-1.0, abs=1e-5)
    assert lf.evidence(pose, hit, field, None, more, least=0.0)[0] == 0.0
    assert lf.evidence(pose, miss, field, None, more, least=0.0)[0] == pytest.approx(floor, abs=1e-5)


def test_distant_beams_are_blurred_by_what_the_heading_may_be_off() -> None:
    points = np.array([[1.0, 4.9, 5.1, 10.1, 20.1, 90.0], np.zeros(6)], np.float32)
    assert lf.levels_of(points, 0.1, 0.02).tolist() == [0, 0, 0, 1, 2, 3]
