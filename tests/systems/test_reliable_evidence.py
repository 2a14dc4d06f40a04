"""What scans say between places: what is new in them, how much that counts, and particles around a scan match."""

from types import SimpleNamespace

import numpy as np
import pytest

from pfcli.core.grid.raycast import cast_many
from pfcli.core.sensor import class_conditional as cc
from pfcli.events import Pose2
from pfcli.events import Scan as LaserScan
from pfcli.params import build
from pfcli.systems.localize_reliable import key_scans, match_proposal, scan_weights
from pfcli.systems.localize_reliable.params import Params
from pfcli.systems.localize_reliable.particle_set import Particles

MODEL = cc.Model(0.05, 0.98, 0.02, 0.5, 0.2, 20.0, 1.0, 0.15)
TURN = np.linspace(-np.pi / 2, np.pi / 2, 61)


def _cells() -> np.ndarray:
    cells = np.zeros((120, 160), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[40:44, 60:90] = cells[80:100, 30:33] = 1
    return cells


@pytest.fixture(scope="module")
def field() -> cc.Field:
    return cc.build(_cells(), 0.05, (0.0, 0.0, 0.0), 20.0)


def _scan(field: cc.Field, pose: np.ndarray) -> cc.Scan:
    """What a scanner sees there, to the middle of the cells that it meets."""
    at = np.repeat(pose[None, :2] / 0.05, TURN.size, 0)
    r = cast_many(field.rays.room, field.rays.cells, at, pose[2] + TURN, 400.0) * 0.05 + 0.025
    return cc.scan_of(np.column_stack([r * np.cos(TURN), r * np.sin(TURN)]), np.zeros(2))


def _key(field: cc.Field, pose: np.ndarray, worth: float = 1.0) -> key_scans.KeyScan:
    scan = _scan(field, pose)
    return key_scans.KeyScan(pose[None], key_scans.placed(pose[None], scan.ends.T), scan, worth)


def test_what_was_seen_is_not_new_wherever_the_robot_has_gone(field: cc.Field) -> None:
    first, later = np.array([2.0, 1.2, 0.3]), np.array([2.1, 1.25, 0.4])
    history = [_key(field, first)]
    scan = _scan(field, later)
    assert key_scans.new_share(scan, first[None], []) == 1.0
    assert key_scans.new_share(_scan(field, first), first[None], history) == 0.0
    # a step away nearly everything was seen; where odometry knows of no step, a scan from elsewhere is new
    assert key_scans.new_share(scan, later[None], history) < 0.2
    elsewhere = _scan(field, np.array([6.0, 4.5, 2.0]))
    assert key_scans.new_share(elsewhere, first[None], history) > 0.5


def test_the_share_that_is_new_equals_its_slow_definition(field: cc.Field) -> None:
    rng = np.random.default_rng(1)
    history = [_key(field, np.array([2.0, 1.5, 0.2])), _key(field, np.array([2.3, 1.6, 0.6]))]
    for _ in range(20):
        odometry = np.array([rng.uniform(1.5, 3.0), rng.uniform(1.0, 2.0), rng.uniform(-1.0, 2.0)])
        scan = _scan(field, odometry + np.array([0.3, 0.0, 0.2]))
        c, s = np.cos(odometry[2]), np.sin(odometry[2])
        unseen = 0
        for x, y in scan.ends.T:
            there = odometry[:2] + np.array([c * x - s * y, s * x + c * y])
            near = 0.1 + 0.02 * np.hypot(x, y)
            best = np.inf
            for key in history:
                k = key.odometry[0]
                for ex, ey in key.scan.ends.T:
                    c2, s2 = np.cos(k[2]), np.sin(k[2])
                    seen = k[:2] + np.array([c2 * ex - s2 * ey, s2 * ex + c2 * ey])
                    best = min(best, float(np.hypot(*(seen - there))))
            unseen += best > near
        assert key_scans.new_share(scan, odometry[None], history) == pytest.approx(unseen / scan.range_m.size)


def test_rivals_gain_on_what_is_believed_by_what_is_new_only() -> None:
    rng = np.random.default_rng(2)
    believed = np.arange(30) < 20
    log_w = np.log(rng.dirichlet(np.ones(30)))
    log, all_of_it = rng.normal(0, 2, 30), rng.normal(0, 2, 30)
    particles = Particles(np.zeros((30, 3)), log_w, np.full(30, 0.5), believed)

    def mass(log_weights: np.ndarray, chosen: np.ndarray) -> float:
        return float(np.log(np.exp(log_weights[chosen]).sum()))

    gained = mass(log_w + log, ~believed) - mass(log_w, ~believed) - mass(log_w + log, believed) + mass(log_w, believed)
    for worth, top in ((0.0, 9.0), (0.3, 9.0), (1.0, 9.0), (1.0, 0.1)):
        after = scan_weights.rivalry(particles, all_of_it, log, worth, top)
        now = mass(after, ~believed) - mass(after, believed)
        before = mass(log_w, ~believed) - mass(log_w, believed)
        assert now - before == pytest.approx(np.clip(worth * gained, -top, top))
        for group in (believed, ~believed):  # within each the whole scan counts
            moved = (after - log_w - all_of_it)[group]
            assert np.ptp(moved) == pytest.approx(0.0, abs=1e-12)


def test_a_turn_brings_in_its_share_of_the_view(field: cc.Field) -> None:
    """A camera of 60 degrees that turns by 15 sees a quarter that is new, and was not carried."""
    ranges = np.ones(61, np.float32)
    scan = LaserScan(0, ranges, -np.pi / 6, np.pi / 180, 0.1, 20.0, Pose2())
    history = [_key(field, np.array([2.0, 1.2, 0.3]))]
    turned = np.array([[2.0, 1.2, 0.3 + np.pi / 12]])
    assert key_scans.turned_share(scan, turned, history) == pytest.approx(15 / 61)
    assert key_scans.turned_share(scan, turned, []) == 0.0


def test_particles_around_a_match_take_their_mass_from_those_they_join(field: cc.Field) -> None:
    """The believed place gains nothing on its rivals by being matched."""
    rng = np.random.default_rng(5)
    true = np.array([2.6, 1.2, 0.4])
    believed = np.arange(500) < 400
    pose = np.where(believed[:, None], true, [6.0, 4.5, 2.0]) + rng.normal(0, [0.05, 0.05, 0.02], (500, 3))
    particles = Particles(pose, np.full(500, -np.log(500)), np.full(500, 0.8), believed)
    params = build(Params, {"match_samples": 4000}, "test")
    assets = SimpleNamespace(field=field)
    key = _key(field, true)
    reading = scan_weights.Reading(0, key.scan, key.scan, key, [], MODEL, 0.2, False)
    after = scan_weights.matched(particles, reading, assets, params, rng)  # type: ignore[arg-type]
    w = np.exp(after.log_w)
    assert w[~after.believed].sum() == pytest.approx(0.2)
    spread = w[500:].std() * np.sqrt(4000)
    assert w[after.believed].sum() == pytest.approx(0.8, abs=5 * spread)
    assert spread < 0.05
    assert after.reliability == pytest.approx(0.8)


def test_a_place_must_explain_the_key_scans_too(field: cc.Field) -> None:
    """Evidence of the past, each key scan by its worth, for poses that came the way odometry tells."""
    path = np.array([[2.0, 1.2, 0.3], [2.3, 1.3, 0.5], [2.6, 1.5, 0.7]])
    history = [_key(field, pose, worth) for pose, worth in zip(path, (1.0, 0.4, 0.2), strict=True)]
    wrong = np.array([5.0, 4.5, -1.0])
    away = path + np.array([0.03, -0.02, 0.0])
    said = [
        0.2 * worth * np.subtract(*cc.fit(np.array(poses), key.scan, field, MODEL).log_likelihood)
        for poses, key, worth in zip(zip(away[:2], path[:2], strict=True), history[:2], (1.0, 0.4), strict=True)
    ]
    for top in (1e6, 0.1):
        found = key_scans.past_evidence(
            np.vstack([path[-1], away[-1], wrong]), path[-1], history, history[-1], field, MODEL, 0.2, top
        )
        assert found[0] == 0.0
        assert found[1] == pytest.approx(np.clip(said, -top, top).sum(), rel=1e-6)
        assert found[2] < -10.0 if top > 10.0 else found[2] == pytest.approx(-2 * top)


def test_the_match_finds_where_the_scan_was_taken(field: cc.Field) -> None:
    true = np.array([2.6, 1.2, 0.4])
    scan = _scan(field, true)
    for off in ([0.15, -0.1, 0.06], [-0.2, 0.1, -0.05], [0.0, 0.0, 0.1]):
        around = match_proposal.Gaussian(true + off, np.diag([0.05, 0.05, 0.02]) ** 2)
        found = match_proposal.match(around, scan, field, MODEL, 0.2)
        assert np.hypot(*(found.mean - true)[:2]) < 0.025  # half a cell
        assert abs(found.mean[2] - true[2]) < np.radians(0.5)
        assert np.linalg.eigvalsh(found.cov).min() > 0.0


def test_samples_around_a_match_are_weighed_by_prediction_over_proposal() -> None:
    """The weights average to the mass of the prediction, and give its mean back, wherever the proposal lies."""
    around = match_proposal.Gaussian(np.array([1.0, 2.0, 0.1]), np.diag([0.1, 0.08, 0.05]) ** 2)
    found = match_proposal.Gaussian(np.array([1.05, 1.98, 0.12]), np.diag([0.08, 0.08, 0.05]) ** 2)
    pose, importance = match_proposal.draw(around, found, 20_000, 1e-9, np.random.default_rng(3))
    w = np.exp(importance)
    error = w.std() / np.sqrt(w.size)
    assert w.mean() == pytest.approx(1.0, abs=5 * error)
    assert error < 0.02
    mean = (w[:, None] * pose).sum(axis=0) / w.sum()
    assert mean == pytest.approx(around.mean, abs=5 * 0.1 * 2 / np.sqrt(w.size))


def test_residuals_by_rays_equal_their_slow_definition(field: cc.Field) -> None:
    """Beam model: what a beam reads less than the first mapped surface, or more than its cell is deep."""
    rng = np.random.default_rng(4)
    model = MODEL._replace(by_rays=True)
    for _ in range(20):
        pose = np.array([rng.uniform(0.5, 2.5), rng.uniform(0.5, 1.8), rng.uniform(-3, 3)])
        exact = _scan(field, pose)
        r = exact.range_m + rng.choice([0.0, -0.6, 0.5], exact.range_m.size)
        scan = cc.scan_of(np.column_stack([r * np.cos(TURN), r * np.sin(TURN)]), np.zeros(2))
        away = cc.classes(pose, scan, field, model).away_m
        expected = exact.range_m - 0.025
        slow = np.maximum(np.maximum(expected - r, r - expected - 0.05), 0.0)
        assert away == pytest.approx(slow, abs=1e-3)
        found = cc.fit(pose[None], scan, field, model)
        assert found.through[0] == pytest.approx(np.mean(r - expected > 0.3))
        assert found.mae_m[0] == pytest.approx(np.minimum(slow, 1.0).mean(), abs=1e-3)


def test_off_the_map_and_in_a_wall_no_ray_sees_anything(field: cc.Field) -> None:
    scan, model = _scan(field, np.array([2.6, 1.2, 0.4])), MODEL._replace(by_rays=True)
    poses = np.array([[2.6, 1.2, 0.4], [-3.0, 1.0, 0.4], [3.5, 2.1, 0.4], [5.0, 4.5, -1.0]])
    found = cc.fit(poses, scan, field, model)
    assert (found.through[1:3] == 1.0).all()
    assert int(np.argmax(found.log_likelihood)) == 0
    assert (found.log_likelihood[1:3] < found.log_likelihood[3]).all()
