"""What the map shows and a trusted place finds gone."""

from pathlib import Path

import numpy as np
import pytest

from pfcli.core.sensor import class_conditional as cc
from pfcli.formats import map_yaml, parquet
from pfcli.initial import Initial
from pfcli.params import build
from pfcli.registry import filter_of, system
from pfcli.replay.log import Log
from pfcli.runs import loop
from pfcli.systems.localize_reliable import map_change, trust_record
from pfcli.systems.localize_reliable.map_change import MapChanges

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
POSE = np.array([2.0, 2.5, 0.0])
ANGLES = np.linspace(-0.6, 0.6, 25)


@pytest.fixture(scope="module")
def field() -> cc.Field:
    """A room of 8 x 5 m with a wall across, in whose middle the door is shut: x = 4 m."""
    cells = np.zeros((100, 160), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[:, 80] = 1
    return cc.build(cells, 0.05, (0.0, 0.0, 0.0), 20.0)


def _scan(pose: np.ndarray, beyond: np.ndarray) -> cc.Scan:
    """Beams that end at the wall across, or `beyond` (b,) it (m)."""
    r = (4.0 - pose[0]) / np.cos(ANGLES) + beyond
    return cc.scan_of(np.column_stack([r * np.cos(ANGLES), r * np.sin(ANGLES)]), np.zeros(2))


DOOR = np.abs(ANGLES) < 0.15
OPEN = np.where(DOOR, 2.0, 0.0)


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_a_crossing_is_where_the_map_shows_the_surface(field: cc.Field, yaw: float) -> None:
    pose = np.array([2.0, 2.5, yaw])
    turned = cc.scan_of(
        _scan(POSE, OPEN).ends.T @ np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]), np.zeros(2)
    )
    found = map_change.crossed(pose, turned, field)
    assert (np.isfinite(found[:, 0]) == DOOR).all()
    assert found[DOOR, 0] == pytest.approx(4.0, abs=0.06)
    assert found[DOOR, 1] == pytest.approx(2.5 + 2.0 * np.tan(ANGLES[DOOR]), abs=0.06)


def test_a_pose_that_is_half_a_metre_off_finds_nothing_gone(field: cc.Field) -> None:
    assert np.isnan(map_change.crossed(POSE, _scan(POSE, np.full(25, 0.6)), field)).all()


def test_a_sensor_that_stands_in_a_surface_finds_nothing_gone(field: cc.Field) -> None:
    inside = np.array([4.02, 2.5, 0.0])
    assert np.isnan(map_change.crossed(inside, _scan(POSE, OPEN), field)).all()


def test_what_was_found_gone_counts_for_some_metres_and_no_longer(field: cc.Field) -> None:
    scan = _scan(POSE, OPEN)
    crossings = map_change.crossed(POSE, scan, field)
    after = map_change.noted(map_change.NOTHING, crossings, 1.0, 0.1, True)
    assert map_change.counted(scan, crossings, map_change.NOTHING, 1.0) is scan
    assert map_change.counted(scan, crossings, after, 1.0 + 0.99 * map_change._COUNTS_M) is scan
    later = map_change.counted(scan, crossings, after, 1.0 + 1.01 * map_change._COUNTS_M)
    assert np.abs(later.ends.T - scan.ends.T[~DOOR]).max() == 0.0
    assert later.range_m == pytest.approx(scan.range_m[~DOOR])
    assert later.turn == pytest.approx(scan.turn[~DOOR])
    # seen again it is nothing new; another door is
    again = map_change.noted(after, crossings, 5.0, 0.1, True)
    assert (again.found == after.found).all()
    other = _scan(POSE, np.where(ANGLES > 0.4, 2.0, 0.0))
    assert map_change.counted(other, map_change.crossed(POSE, other, field), after, 9.0) is other
    assert map_change.counted(scan, crossings, map_change.forgotten(after), 9.0) is scan
    old = map_change.noted(after, np.full((25, 2), np.nan), 1.0 + 1.01 * map_change._KEPT_M, 0.1, True)
    assert old.found.shape == after.found.shape  # nothing was found: nothing is looked through
    elsewhere = map_change.crossed(POSE, other, field)
    assert map_change.noted(after, elsewhere, 1.0 + 1.01 * map_change._KEPT_M, 0.1, True).found[:, 2].min() > 100.0
    # a scan keeps some beams
    everything = np.full((25, 2), after.found[0, :2])
    assert map_change.counted(scan, everything, after, 9.0) is scan


def test_what_a_place_that_is_not_trusted_contradicts_is_kept_against_it(field: cc.Field) -> None:
    crossings = map_change.crossed(POSE, _scan(POSE, OPEN), field)
    assert map_change.noted(map_change.NOTHING, crossings, 1.0, 0.1, False).found.shape == (0, 3)
    found, record = 0.0, trust_record.NOTHING
    while not trust_record.outlasts_wrong(record):
        record, found = trust_record.trusted(record, 0.8, 0.1), found + 0.1
    assert found == pytest.approx(trust_record._WRONG_M / 0.8, abs=0.11)
    assert not trust_record.outlasts_wrong(trust_record.given_up(record, 9.0))
    assert not trust_record.outlasts_wrong(trust_record.doubted(record))
    assert trust_record.outlasts_wrong(trust_record.TOLD)


def test_the_share_of_beams_beyond_is_a_mean_over_the_way() -> None:
    rng = np.random.default_rng(3)
    seen, steps, state = rng.random(200), rng.uniform(0.0, 0.3, 200), MapChanges(map_change.NOTHING.found, 0.0)
    slow = 0.0
    for share, step in zip(seen, steps, strict=True):
        crossings = np.full((1000, 2), np.nan)
        crossings[: int(1000 * share)] = 1.0
        state = map_change.noted(state, crossings, 0.0, step, False)
        fades = np.exp(-max(step, 0.05) / 5.0)
        slow = fades * slow + (1.0 - fades) * int(1000 * share) / 1000
    assert state.share == pytest.approx(slow, rel=1e-9)
    assert not map_change.map_holds(state)
    assert map_change.map_holds(map_change.NOTHING)


def test_a_wall_that_is_gone_does_not_make_a_right_place_doubtful_for_long(tmp_path: Path) -> None:
    """The sample loop, driven twice, in a map with a wall across the corridor that is not there."""
    log, grid = SAMPLES / "small-loop.mcap", map_yaml.read(SAMPLES / "small-loop.yaml")
    truth = {e.stamp_ns: np.array(e[1:4]) for e in Log(log).events(["truth"])}
    poses = np.array(list(truth.values()))
    way = np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))
    x, y, yaw = poses[1 + int(np.searchsorted(way, 16.0))]
    across = np.linspace(-1.5, 1.5, 121)
    xy = np.column_stack([x - across * np.sin(yaw), y + across * np.cos(yaw)])
    col, row = ((xy - grid.origin[:2]) / grid.resolution_m).astype(int).T
    grid.cells[row, col] = 1
    map_yaml.write(tmp_path, grid)
    reliable, doubtful = system("localize-reliable"), {}
    for counts in (True, False):
        params = build(reliable.params, {"map_changes": counts}, "test")
        start = Initial("pose", tuple(poses[0]))
        done = loop.execute(loop.Job(reliable, params, [log], 1, map=tmp_path / "map.yaml", initial=start))
        rows = {k: np.asarray(v) for k, v in parquet.columns_of(done.infos, filter_of(reliable).info).items()}
        at = done.result.track.poses[done.result.track.columns["update"]]
        error = np.hypot(*(at - np.array([truth[t] for t in rows["t_ns"].tolist()]))[:, :2].T)
        assert np.mean(error <= rows["protection_m"]) > 0.99
        doubtful[counts] = np.mean(rows["p_success"] < 0.5)
        assert np.any(rows["gone"] > 0.05) == counts
    assert doubtful[True] < 0.5 * doubtful[False]
