"""The class-conditional likelihood against its slow definition, beams that pass through walls, classes of beams."""

import numpy as np
import pytest

from pfcli.core.sensor import class_conditional as cc

MODEL = cc.Model(0.05, 0.95, 0.05, 0.6, 0.3, 20.0, 1.0, 0.15)


def _cells() -> np.ndarray:
    cells = np.zeros((80, 120), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[:, 60] = 1
    return cells


@pytest.fixture(scope="module")
def field() -> cc.Field:
    return cc.build(_cells(), 0.05, (0.0, 0.0, 0.0), 20.0)


def _scan(pose: np.ndarray, ends_map: np.ndarray) -> cc.Scan:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    off = ends_map - pose[:2]
    return cc.scan_of(np.column_stack([c * off[:, 0] + s * off[:, 1], -s * off[:, 0] + c * off[:, 1]]), np.zeros(2))


def test_the_likelihood_equals_its_slow_definition(field: cc.Field) -> None:
    """Akai 2023: sum over classes of p(z | x, c, m) p(c), beams multiplied."""
    rng = np.random.default_rng(0)
    scan = cc.scan_of(rng.uniform(-0.9, 0.9, (21, 2)), np.zeros(2))
    poses = np.column_stack([rng.uniform(1.4, 2.4, 30), rng.uniform(1.4, 2.6, 30), rng.uniform(-3, 3, 30)])
    found = cc.fit(poses, scan, field, MODEL)
    walls = np.argwhere(_cells() == 1)
    for k, pose in enumerate(poses):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        x = pose[0] + c * scan.ends[0] - s * scan.ends[1]
        y = pose[1] + s * scan.ends[0] + c * scan.ends[1]
        cell = np.floor(np.column_stack([y, x]) / 0.05)
        d = np.array([np.hypot(*(walls - p).T).min() * 0.05 for p in cell])
        hit = 0.95 / (0.05 * np.sqrt(2 * np.pi)) * np.exp(-0.5 * (d / 0.05) ** 2) + 0.05 / 20.0
        unknown = 0.3 * np.exp(-0.3 * scan.range_m) / (1 - np.exp(-0.3 * 20.0))
        assert (found.through[k] == 0.0) == bool((x < 3.3).all())
        if found.through[k] == 0.0:
            total = np.log(0.6 * hit + 0.4 * unknown).sum()
            assert found.log_likelihood[k] == pytest.approx(total, abs=0.05)
            assert found.mae_m[k] == pytest.approx(np.minimum(d, 1.0).mean(), abs=1e-6)
            assert found.hits[k] == pytest.approx(np.mean(d <= 0.15))


@pytest.mark.parametrize("by_rays", [False, True])
def test_blocks_of_poses_change_nothing(field: cc.Field, by_rays: bool) -> None:
    """Poses on and off the map, in a block and across its border."""
    rng = np.random.default_rng(1)
    scan = cc.scan_of(rng.uniform(-1.5, 1.5, (13, 2)), np.array([0.2, 0.1]))
    poses = rng.uniform([-2.0, -2.0, -4.0], [8.0, 6.0, 4.0], (2 * cc._BLOCK + 5, 3))
    poses[:3, 2] = [-1e-12, -1e-18, 2 * np.pi]  # a heading of nearly a whole turn
    model = MODEL._replace(by_rays=by_rays)
    whole = cc.fit(poses, scan, field, model)
    parts = [cc.fit(part, scan, field, model) for part in np.split(poses, [13, cc._BLOCK + 1])]
    for k in range(4):
        assert np.concatenate([part[k] for part in parts]).tobytes() == whole[k].tobytes()


def test_what_is_no_number_is_off_the_map(field: cc.Field) -> None:
    """Some drivers write the largest float for 'nothing seen'; in single precision its end point is no number."""
    rng = np.random.default_rng(2)
    near = rng.uniform(-0.5, 0.5, (9, 2))
    far = np.full((1, 2), 2e38)
    pose = np.array([[2.0, 2.0, 0.3]])
    fit = cc.fit(pose, cc.scan_of(np.vstack([near, far]), np.zeros(2)), field, MODEL)
    assert fit.mae_m == pytest.approx(cc.fit(pose, cc.scan_of(near, np.zeros(2)), field, MODEL).mae_m)
    nowhere = np.array([[np.nan, 1.0, 0.0], [1.0, 1.0, np.nan], [1.0, 1.0, np.inf], [1e300, 1.0, 0.0]])
    assert np.isnan(cc.fit(nowhere, cc.scan_of(near, np.zeros(2)), field, MODEL).mae_m).all()


def test_a_map_without_a_free_coarse_cell_can_be_asked() -> None:
    cells = np.zeros((40, 40), np.int8)
    cells[::2] = 1
    field = cc.build(cells, 0.05, (0.0, 0.0, 0.0), 20.0)
    fit = cc.fit(np.array([[1.0, 1.0, 0.0]]), cc.scan_of(np.full((3, 2), 0.2), np.zeros(2)), field, MODEL)
    assert np.isfinite(fit.log_likelihood).all()


def test_a_beam_that_would_pass_through_a_wall_is_no_unknown_obstacle(field: cc.Field) -> None:
    pose = np.array([1.5, 2.0, 0.4])
    turn = np.linspace(-0.3, 0.3, 9)
    short = _scan(pose, np.column_stack([pose[0] + 0.8 * np.cos(turn), pose[1] + 0.8 * np.sin(turn)]))
    beyond = _scan(pose, np.column_stack([pose[0] + 2.4 * np.cos(turn), pose[1] + 2.4 * np.sin(turn)]))
    before, behind = (cc.fit(pose[None], scan, field, MODEL) for scan in (short, beyond))
    assert before.through[0] == 0.0
    assert behind.through[0] == 1.0
    assert behind.log_likelihood[0] < before.log_likelihood[0] - 9 * 2.0


def test_classes_of_beams(field: cc.Field) -> None:
    """Akai 2023, eq. (3): a hit on the wall is known, one half a metre before it is not."""
    pose = np.array([1.5, 2.0, -1.0])
    scan = _scan(pose, np.array([[3.0, 2.0], [2.5, 2.0], [0.02, 2.0], [0.7, 2.0]]))
    found = cc.classes(pose, scan, field, MODEL)
    assert (found.p_unknown > 0.5).tolist() == [False, True, False, True]
    assert found.away_m == pytest.approx([0.0, 0.55, 0.0, 0.7], abs=0.06)


def test_no_beam_on_the_map_is_no_evidence(field: cc.Field) -> None:
    from pfcli.systems.localize_reliable.success_decision import Classifier, log_ratio

    scan = cc.scan_of(np.array([[50.0, 50.0], [60.0, 50.0]]), np.zeros(2))
    fit = cc.fit(np.array([[1.0, 1.0, 0.0]]), scan, field, MODEL)
    assert np.isnan(fit.mae_m[0])
    assert log_ratio(fit, Classifier(np.array([-2.0, 1.0, -50.0]), 1.0, 0.9, (1.0, 1.0, 1.0)))[0] == 0.0
