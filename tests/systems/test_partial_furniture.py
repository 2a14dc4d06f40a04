"""Things that stand in the map and are not drawn in it do not put a robot outside."""

import numpy as np
import pytest

from pfcli.core.estimate import PoseEstimate
from pfcli.core.grid import rolling_grid
from pfcli.core.grid.grid_map import GridMap
from pfcli.core.grid.region import region_of
from pfcli.core.sensor import likelihood_field
from pfcli.events import Pose2
from pfcli.initial import Initial
from pfcli.rng import Draw
from pfcli.systems.localize_partial import relocalise, unmapped_things, update_corrected
from pfcli.systems.localize_partial.class_belief import Reading
from pfcli.systems.localize_partial.incomplete_map import Assets, model_of
from pfcli.systems.localize_partial.params import Params
from pfcli.systems.localize_partial.unmapped_things import Standing, View

PARAMS = Params()
POSE = np.array([2.0, 1.5, 0.0])


@pytest.fixture(scope="module")
def assets() -> Assets:
    """A room of 5 x 2 m whose east is unknown, with a wall across its middle."""
    cells = np.full((60, 220), -1, np.int8)
    cells[10:50, 10:110] = 0
    cells[9, 10:110] = cells[50, 10:110] = 1
    cells[9:51, 9] = 1
    cells[20:40, 70] = 1
    region = region_of(cells, 0.05, (0.0, 0.0, 0.0))
    field = likelihood_field.build(cells, 0.05, (0.0, 0.0, 0.0), model_of(PARAMS), unknown=True)
    return Assets(GridMap(cells, 0.05, Pose2()), region, field, Initial(), region.free_xy)


def _view(things: np.ndarray) -> View:
    """A scan of the walls from POSE, after beams that end at `things` (2, k)."""
    across = np.linspace(-1.2, 1.2, 15)
    walls = [np.stack([across, np.full(15, wall - 1.5)]) for wall in (0.475, 2.525)]
    ends = np.ascontiguousarray(np.concatenate([things, *walls], axis=1), np.float32)
    return View(np.zeros(2), ends, np.zeros(ends.shape[1], np.int32))


BEFORE = np.stack([np.linspace(0.4, 1.0, 8), np.full(8, 0.5)])
BEHIND = np.stack([np.full(8, 2.2), np.linspace(-0.3, 0.3, 8)])


def test_what_ends_before_a_wall_is_a_thing_where_the_scan_fits(assets: Assets) -> None:
    found = unmapped_things.things(POSE, _view(BEFORE), assets, PARAMS)
    assert found.tolist() == [True] * 8 + [False] * 30
    # nothing that the map lacks stands behind its walls: 8 of 38 is another place
    assert not unmapped_things.things(POSE, _view(BEHIND), assets, PARAMS).any()
    # and where most beams miss the map the robot is elsewhere
    assert not unmapped_things.things(POSE, _view(np.tile(BEFORE, 5)), assets, PARAMS).any()


def test_beams_that_pass_a_mapped_wall_are_no_things_where_few_do(assets: Assets) -> None:
    view = _view(np.concatenate([BEFORE, BEHIND[:, :3]], axis=1))
    assert unmapped_things.things(POSE, view, assets, PARAMS).tolist() == [True] * 8 + [False] * 33


def _reading(view: View, things: np.ndarray | None) -> Reading:
    """The last metres have confirmed all of the scan."""
    best = float(likelihood_field.log_ratio(np.zeros(1), model_of(PARAMS))[0])
    base = np.full((2, view.ends.shape[1]), best - PARAMS.history_margin, np.float32)
    return Reading(
        moved=np.array([0.1, 0.0, 0.0]),
        first=False,
        ends=view.ends,
        level=view.level,
        base=base,
        stamp_ns=7,
        things=things,
    )


def _settled(reading: Reading, assets: Assets) -> float:
    pose = np.tile(POSE, (200, 1))
    here = relocalise.Placed(pose, np.full(200, 3, np.uint8), np.full(200, 1 / 200))
    ratios = update_corrected._log_ratios(here.pose, here.label, reading, assets, PARAMS)
    found = update_corrected._settled(here, ratios, reading, assets, PARAMS, Draw(0))
    assert found is not None
    return found


def test_a_settled_place_accounts_for_its_things_once(assets: Assets) -> None:
    view = _view(BEFORE)
    things = unmapped_things.things(POSE, view, assets, PARAMS)
    assert _settled(_reading(view, None), assets) < -1.0
    assert _settled(_reading(view, things), assets) >= 0.0


def test_only_so_many_beams_are_taken_for_things(assets: Assets) -> None:
    """Twice as many as are forgiven: half of what they say is held against the place."""
    base = np.full((2, 10), 2.0, np.float32)
    all_of_them = unmapped_things.forgiven(base, np.ones(10, np.bool_), PARAMS)
    nothing = np.log(1.0 - PARAMS.z_hit)
    share = unmapped_things.MOST
    assert np.allclose(all_of_them[1], share * nothing + (1.0 - share) * 2.0)
    some = unmapped_things.forgiven(base, np.arange(10) < 3, PARAMS)
    assert np.allclose(some[1], [nothing] * 3 + [2.0] * 7)
    assert np.all(some[0] == 2.0)


def test_things_are_marked_at_a_place_that_is_believed_and_nowhere_else(assets: Assets) -> None:
    view = _view(BEFORE)
    for mass, sd_m, marks in ((0.9, 0.1, True), (0.3, 0.1, False), (0.9, 0.5, False)):
        local = rolling_grid.empty()
        found = PoseEstimate(POSE, np.diag([sd_m**2 / 2, sd_m**2 / 2, 0.01]), mass)
        unmapped_things.mark(local, np.zeros(3), 1.0, found, view, assets, PARAMS)
        known = rolling_grid.marked(local, np.zeros(3), view.ends, np.float32(1.0), 15.0)
        assert known[:8].all() == marks
        assert not known[23:].any()


def test_who_was_outside_or_carried_has_to_explain_all_that_is_seen() -> None:
    assert unmapped_things.at_start("unknown").may_be_inside
    assert not unmapped_things.at_start("outside").may_be_inside
    here = Standing(True)
    assert not unmapped_things.after(here, 1.0, 0.1, True).may_be_inside
    for _ in range(101):  # of 0.1 m each
        here = unmapped_things.after(here, 0.05, 0.1, False)
    assert not here.may_be_inside
    for _ in range(101):
        here = unmapped_things.after(here, 0.95, 0.1, False)
    assert here.may_be_inside
    assert unmapped_things.after(Standing(True, 9.9), 0.5, 0.2, False) == Standing(True)


def test_a_scan_that_is_new_beyond_what_a_turn_brings_is_of_another_place() -> None:
    explained = np.where(np.arange(100) < 40, 0.0, 1.0).astype(np.float32)
    assert unmapped_things.is_carried(explained, 0.0, np.pi)
    assert not unmapped_things.is_carried(explained, 1.0, np.pi)


def test_who_looks_for_the_place_is_judged_by_what_is_new(assets: Assets) -> None:
    """After an unknown start two places explain the scan, one of them badly: all of it moves weight between them, but for inside
    or outside only the beams count that the last metres do not explain. Brute force over the beams."""
    view = _view(BEFORE)
    reading = _reading(view, None)._replace(way_m=1.0)
    new = np.arange(view.ends.shape[1]) % 3 == 0
    base = reading.base.copy()
    base[:, new] = 0.0
    reading = reading._replace(base=base)
    pose = np.repeat(np.array([POSE, POSE + np.array([1.0, 0.0, 0.02])]), 100, axis=0)
    here = relocalise.Placed(pose, np.full(200, 3, np.uint8), np.full(200, 1 / 200))
    ratios = update_corrected._log_ratios(pose, here.label, reading, assets, PARAMS)
    found = update_corrected._settled(here, ratios, reading, assets, PARAMS, Draw(0))

    def beams(p: np.ndarray) -> np.ndarray:
        value = likelihood_field.of_beams(p, view.ends, assets.field, view.level).astype(float)
        hit = np.where(value > 0.0, value - base[0], np.minimum(0.0, value - base[1]))
        return PARAMS.beam_gain * np.where(value < likelihood_field.UNKNOWN, hit, 0.0)

    by_beam = np.array([beams(p) for p in (pose[0], pose[-1])])
    old = np.exp(by_beam[:, ~new].sum(axis=1))
    both = np.exp(by_beam.sum(axis=1))
    assert found == pytest.approx(np.log(both.sum() / old.sum()), abs=1e-4)
    assert update_corrected._settled(here, ratios, reading._replace(way_m=9.0), assets, PARAMS, Draw(0)) is None
