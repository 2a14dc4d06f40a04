"""The six states, their probabilities, and what the printed algorithm makes of them."""

import itertools
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pfcli.core.evaluation import track_error
from pfcli.core.grid.distance import distance_m
from pfcli.core.grid.grid_map import GridMap
from pfcli.core.grid.region import crosses_wall, places, region_of
from pfcli.core.grid.tiles import Beams
from pfcli.core.sensor import likelihood_field
from pfcli.events import Pose2
from pfcli.initial import Initial
from pfcli.registry import system
from pfcli.replay.log import Log
from pfcli.rng import Draw
from pfcli.runs import loop
from pfcli.simulation.indoor_world import WORLDS, rasterize
from pfcli.systems.localize_partial import (
    annealed_sampler,
    class_smoother,
    cluster_kernels,
    cluster_resampling,
    filter,
    map_extension,
    matched_odometry,
    pose_smoother,
    relocalise,
    update_corrected,
    update_paper,
)
from pfcli.systems.localize_partial.class_belief import Belief, Past, Reading
from pfcli.systems.localize_partial.cluster_resampling import Limits
from pfcli.systems.localize_partial.incomplete_map import Assets
from pfcli.systems.localize_partial.params import Params
from pfcli.systems.localize_partial.relocalise import Placed

MODEL = likelihood_field.Model(0.1, 0.8, 5.0)


def _cells() -> np.ndarray:
    cells = np.full((60, 220), -1, np.int8)
    cells[10:50, 10:110] = 0
    cells[9, 10:110] = cells[50, 10:110] = 1
    cells[9:51, 9] = 1
    return cells


@pytest.fixture(scope="module")
def assets() -> Assets:
    region = region_of(_cells(), 0.05, (0.0, 0.0, 0.0))
    field = likelihood_field.build(_cells(), 0.05, (0.0, 0.0, 0.0), MODEL, unknown=True)
    return Assets(GridMap(_cells(), 0.05, Pose2()), region, field, Initial(), region.free_xy)


def _reading(moved: float, ends: np.ndarray, first: bool = False) -> Reading:
    ends = np.ascontiguousarray(ends, np.float32)
    n = ends.shape[1]
    return Reading(np.array([moved, 0.0, 0.0]), first, ends, np.zeros(n, np.int32), np.zeros((2, n), np.float32), 7)


def test_moves_change_classes_as_table_1_says(assets: Assets) -> None:
    inside, outside = [3.0, 1.5, 0.0], [7.0, 1.5, 0.0]
    poses = np.array([inside] * 3 + [[5.4, 1.5, 0.0]] + [outside] * 2 + [[5.6, 1.5, np.pi]] * 2)
    classes = np.array([2, 3, 6, 3, 4, 5, 4, 5], np.uint8)
    step = np.array([0.2, 0.0, 0.0])
    _, labels, factor = cluster_kernels.move(poses, classes, step, np.zeros(3), np.zeros((8, 3)), assets.region)
    assert labels.tolist() == [3, 3, 3, 4, 5, 5, 6, 6]
    assert (factor == 1.0).all()


def test_a_particle_that_drives_through_a_wall_is_nearly_killed_and_not_called_outside(assets: Assets) -> None:
    pose = np.array([[3.0, 0.6, -np.pi / 2]])
    step = np.array([0.2, 0.0, 0.0])
    _, _, factor = cluster_kernels.move(
        pose, np.array([3], np.uint8), step, np.zeros(3), np.zeros((1, 3)), assets.region
    )
    assert factor[0] == cluster_kernels.WALL_FACTOR


def test_moves_far_from_walls_are_not_asked_and_the_answer_is_the_same() -> None:
    cells = np.zeros((60, 80), np.int8)
    cells[20:40, 30] = cells[0] = 1
    turned = region_of(cells, 0.05, (2.0, -1.0, 0.6))
    rng = np.random.default_rng(3)
    pose = np.column_stack([rng.uniform(-2, 7, 3000), rng.uniform(-3, 5, 3000), rng.uniform(-3, 3, 3000)])
    step, sd, z = np.array([0.3, 0.0, 0.1]), np.array([0.1, 0.1, 0.1]), rng.standard_normal((3000, 3))
    moved, _, factor = cluster_kernels.move(pose, np.full(3000, 3, np.uint8), step, sd, z, turned)
    crossed = [crosses_wall(turned.place, turned.frame, *p[:2], *q[:2]) for p, q in zip(pose, moved, strict=True)]
    assert (factor == np.where(crossed, cluster_kernels.WALL_FACTOR, 1.0)).all()
    assert 30 < sum(crossed) < 1000


def test_entries_stand_at_the_frontier_and_were_outside_before_the_step(assets: Assets) -> None:
    u = np.random.default_rng(0).random((4000, 4))
    step = np.array([0.1, 0.0, 0.2])
    region = assets.region
    count = int(np.searchsorted(region.edge_m, 0.12, side="right"))
    found = cluster_kernels.entries(region.edge_xy, count, 0.05, step, u, region.place, region.frame, True)
    before = found[:, 2] - step[2]
    xy = found[:, :2] - 0.1 * np.stack([np.cos(before), np.sin(before)], 1)
    assert 100 < len(found) < 4000
    assert (found[:, 0] > 5.3).all()
    assert (places(region, xy) == 0).all()


def test_those_without_a_pose_are_looked_for_only_where_that_is_worth_it(assets: Assets) -> None:
    reading, params = _reading(0.1, _seen_from(3.0, 1.5)), Params(frontier_samples=500)
    for inside, outside, classes in ((2.9e-4, 2.9e-4, set()), (2.9e-4, 3.1e-4, {2}), (3.1e-4, 2.9e-4, {3})):
        transition = np.zeros((7, 7))
        transition[0, 0], transition[1, 1] = inside, outside
        before = np.array([inside, outside])
        found, left = relocalise.search(before, reading, transition, assets, params, Draw(0))
        assert set(found.label.tolist()) == classes
        assert transition.sum() == pytest.approx(before.sum(), abs=1e-12)
        assert transition.sum(axis=0)[:2] == pytest.approx(left, abs=1e-12)
        assert (left < before).tolist() == [3 in classes, 2 in classes]


def test_a_robot_was_carried_only_where_the_last_metres_foretell_nothing(assets: Assets) -> None:
    weight, params = np.array([0.5, 0.3]), Params(kidnap_per_m=0.5, beam_gain=0.1)
    carried = 1.0 - np.exp(-0.5 * 0.1)
    for foretold, share in ((0.0, 1.0), (0.2, np.exp(-0.1 * 0.2 * 40))):
        reading = _reading(0.1, np.zeros((2, 40)))._replace(base=np.full((2, 40), foretold, np.float32))
        transition = np.zeros((7, 7))
        transition[3, 3], transition[5, 5] = weight
        kept, left = relocalise.lose(weight, np.array([0.0, 0.2]), reading, transition, params)
        astray = 0.2 * carried / 2  # a robot that has lost its way may be wrong about being outside
        each = 0.8 * carried * share / 2
        assert kept == pytest.approx(weight * (1.0 - carried))
        assert left == pytest.approx([each + astray, 0.2 + each - astray], rel=1e-6)
        assert transition.sum(axis=0)[:2] == pytest.approx(left, rel=1e-6)
        assert transition[[3, 5], [3, 5]] == pytest.approx(weight * (1.0 - carried))


def test_who_is_elsewhere_keeps_up_with_class_3_and_with_the_outside_but_not_for_long() -> None:
    threes, weight = np.array([True, True, False]), np.array([0.3, 0.1, 0.6])
    for after, outside, best in (
        ([0.9, 0.1, 0.0], 0.5, 2.5),  # class 3 fits: who is elsewhere would fit there
        ([0.0, 0.0, 0.6], 1.0, 1.0),  # it does not: neither is evidence
        ([0.1, 0.1, 0.0], 0.8, 0.8),
    ):
        found = relocalise.elsewhere(threes, weight, np.array(after), float(np.log(outside)), 0.9)
        assert found == pytest.approx(np.log(best) - 0.9 / 4.5)
    nobody = relocalise.elsewhere(np.zeros(3, np.bool_), weight, weight, -0.3, 0.0)
    assert nobody == pytest.approx(-0.3)


def test_who_is_found_late_is_judged_by_the_last_metres_too(assets: Assets) -> None:
    """Poses of a place that also fitted the scan before, half a metre behind, against such as fit now only."""
    now, params = _reading(0.0, _seen_from(2.5, 1.5)), Params(beam_gain=0.1)
    before = Past(np.array([3.5, 2.0, np.pi / 2]), *_reading(0.0, _seen_from(2.0, 1.5))[2:5], 0.25)
    poses = np.array([[2.5, 1.5, 0.0], [3.4, 1.5, np.pi / 2]])
    found = relocalise._hindsight(
        poses, now._replace(reckoned=np.array([3.5, 2.5, np.pi / 2]), past=(before, before)), assets, params
    )
    top = 0.1 * 90 * likelihood_field.log_ratio(np.full(1, 0.025), MODEL)[0]
    assert found[0] == pytest.approx(2 * (top - 0.25), rel=0.02)
    assert found[1] == pytest.approx(2 * (-relocalise.MOST_AGAINST - 0.25)), (
        "a scan ends what it can say against a place"
    )
    assert relocalise._hindsight(poses, now, assets, params).tolist() == [0.0, 0.0]


def test_who_is_lost_in_the_map_is_found_there_and_not_called_outside(assets: Assets) -> None:
    """A robot that fits nowhere is as likely to be elsewhere in the map: no exit was seen."""
    belief = Belief(np.empty((0, 3)), np.empty(0, np.uint8), np.empty(0), np.array([0.5, 0.5, 0, 0, 0, 0, 0]))
    for k in range(12):
        reading = _reading(0.0, _seen_from(2.0, 1.5))._replace(stamp_ns=k)
        belief = update_corrected.update(belief, reading, assets, Params(frontier_samples=1000, beam_gain=0.3), Draw(0))
    best = belief.pose[np.argmax(belief.weight)]
    assert belief.b[0] + belief.b[3] > 0.95
    assert np.hypot(best[0] - 2.0, best[1] - 1.5) < 0.15


def test_flows_add_up_to_the_weights() -> None:
    before, after = np.array([2, 3, 3, 5], np.uint8), np.array([3, 3, 4, 6], np.uint8)
    found = cluster_kernels.flow(before, after, np.array([0.1, 0.2, 0.3, 0.4]))
    assert found[2, 3] == 0.1
    assert found[3, 3] == 0.2
    assert found[3, 4] == 0.3
    assert found[5, 6] == 0.4
    assert found.sum() == pytest.approx(1.0)


def test_the_likelihood_counts_once_where_the_paper_counts_it_twice() -> None:
    """Fact sheet: 100 particles with p = {1, 99 x 0.01}: correct mean 0.0199, as printed sum p^2 / sum p = 0.507."""
    p = np.r_[1.0, np.full(99, 0.01)]
    w = np.full(100, 0.01)
    assert w @ p == pytest.approx(0.0199)
    printed = w * p / (w @ p)
    assert printed @ p == pytest.approx(0.507, abs=1e-3)


def _two_classes(assets: Assets) -> tuple[Belief, np.ndarray]:
    """Class 3 in one place that fits and 99 that do not, class 6 in 100 that half fit."""
    rng = np.random.default_rng(5)
    ends = np.array([[0.0, 0.5, -0.5, 1.0], [1.03, 1.03, 1.03, -0.97]])
    good, bad = (
        np.array([[3.0, 1.5, 0.0]]),
        np.column_stack([rng.uniform(2, 4, 99), np.full(99, 1.0), np.full(99, 1.0)]),
    )
    half = np.column_stack([rng.uniform(2, 4, 100), np.full(100, 1.4), np.zeros(100)])
    poses = np.concatenate([good, bad, half])
    labels = np.r_[np.full(100, 3), np.full(100, 6)].astype(np.uint8)
    b = np.array([0, 0, 0, 0.5, 0, 0, 0.5])
    return Belief(poses, labels, np.full(200, 0.005), b), ends


def test_both_variants_follow_their_equations(assets: Assets) -> None:
    belief, ends = _two_classes(assets)
    params = Params(beam_gain=1.0, outside_likelihood=False, frontier_samples=1, kld=False, resample_threshold=0.0)
    likelihood = np.exp(likelihood_field.evidence(belief.pose, np.float32(ends), assets.field))
    mean3, mean6 = likelihood[:100].mean(), likelihood[100:].mean()
    reading = _reading(0.0, ends, first=True)
    fixed = assets._replace(initial=Initial("pose"))
    mended = update_corrected.update(belief, reading, fixed, params, Draw(0))
    assert mended.b[3] == pytest.approx(mean3 / (mean3 + mean6), rel=1e-6)
    printed = update_paper.update(belief, reading, fixed, params, Draw(0))
    twice3 = (likelihood[:100] ** 2).sum() / likelihood[:100].sum()
    twice6 = (likelihood[100:] ** 2).sum() / likelihood[100:].sum()
    assert printed.b[3] == pytest.approx(twice3 / (twice3 + twice6), rel=1e-6)
    assert printed.b[3] > mended.b[3]


def test_scans_move_weight_to_the_outside_only_where_that_is_asked_for(assets: Assets) -> None:
    belief, _ = _two_classes(assets)
    wrong = np.array([[0.3, 0.4, 0.5, 0.6], [0.2, 0.1, -0.1, -0.2]])
    belief = belief._replace(b=np.array([0, 0.2, 0, 0.4, 0, 0, 0.4]), weight=np.full(200, 0.004))
    fixed = assets._replace(initial=Initial("pose"))
    reading = _reading(0.0, wrong, first=True)
    on = update_corrected.update(belief, reading, fixed, Params(beam_gain=1.0), Draw(0))
    off = update_corrected.update(belief, reading, fixed, Params(beam_gain=1.0, outside_likelihood=False), Draw(0))
    assert on.b[1] > 0.4
    assert off.b[1] == pytest.approx(0.2)


def _seen_from(x: float, y: float) -> np.ndarray:
    """End points of a scan of the room's three walls from a pose that looks along x."""
    across = np.linspace(-1.5, 1.5, 30)
    rows = [np.stack([across, np.full(30, wall - y)]) for wall in (0.475, 2.525)]
    return np.concatenate([*rows, np.stack([np.full(30, 0.475 - x), np.linspace(0.6, 2.4, 30) - y])], axis=1)


def _explained(margin: float) -> Reading:
    """That scan from (2.0, 1.5), which the last metres explain as well, but for a margin."""
    best = likelihood_field.log_ratio(np.zeros(1), MODEL)[0]
    base = np.full((2, 90), best - margin, np.float32)
    return _reading(0.0, _seen_from(2.0, 1.5))._replace(base=base)


def test_what_map_and_last_metres_both_explain_drives_nobody_out(assets: Assets) -> None:
    """A robot that turns spreads its particles; the last metres, asked at one pose, would win scan after scan."""
    rng = np.random.default_rng(9)
    poses = np.array([2.0, 1.5, 0.0]) + [0.05, 0.05, 0.06] * rng.standard_normal((500, 3))
    labels, weights = np.full(500, 3, np.uint8), np.full(500, 1 / 500)
    reading = _explained(0.0)
    params = Params(beam_gain=0.1)
    ratios = update_corrected._log_ratios(poses, labels, reading, assets, params)
    assert np.log(np.mean(np.exp(ratios))) < 0.0
    here = relocalise.Placed(poses, labels, weights)
    settled = update_corrected._settled(here, ratios, reading, assets, params, Draw(0))
    assert settled is not None
    assert settled >= 0.0
    apart = poses + np.where(np.arange(500)[:, None] % 2 == 0, [1.5, 0.0, 0.0], 0.0)
    assert update_corrected._settled(here._replace(pose=apart), np.zeros(500), reading, assets, params, Draw(0)) is None
    nothing = reading._replace(ends=np.full((2, 90), 0.2, np.float32))
    contradicted = update_corrected._settled(here, ratios, nothing, assets, params, Draw(0))
    assert contradicted is not None
    assert contradicted < settled


def _weighed_slowly(
    labels: np.ndarray, weights: np.ndarray, log_ratio: np.ndarray, settled: float | None, against: float
) -> tuple[np.ndarray, float]:
    """What `kernels.weigh` gives, as its docstring says it."""
    inside = np.isin(labels, (2, 3, 6))
    if settled is not None:
        here = labels == 3
        mean = np.log(np.average(np.exp(log_ratio[here]), weights=weights[here]))
        log_ratio = log_ratio + np.where(here, max(0.0, settled - mean), 0.0)
    if inside.any():
        log_ratio = log_ratio + np.where(inside, max(0.0, -against - log_ratio[inside].max()), 0.0)
    top = max(0.0, log_ratio.max())
    return weights * np.exp(log_ratio - top), top


def test_weights_after_a_scan_equal_their_slow_definition() -> None:
    rng = np.random.default_rng(12)
    for trial in range(500):
        n = int(rng.integers(1, 40))
        labels, weights = rng.integers(2, 7, n).astype(np.uint8), rng.random(n)
        inside = np.isin(labels, (2, 3, 6))
        log_ratio = np.where(inside, rng.normal(rng.choice([-5, 0, 5]), rng.choice([0.1, 3.0, 30.0]), n), 0.0)
        settled = float(rng.normal(0, 3)) if (labels == 3).any() and trial % 3 else None
        least = -np.inf if settled is None else settled
        found, total, top, before, after = cluster_kernels.weigh(labels, weights, log_ratio, least, 1.0)
        slow, slow_top = _weighed_slowly(labels, weights, log_ratio, settled, 1.0)
        assert found == pytest.approx(slow, rel=1e-9, abs=1e-300)
        assert top == pytest.approx(slow_top, abs=1e-9)
        assert total == pytest.approx(slow.sum(), rel=1e-9)
        assert (before, after) == pytest.approx((weights[inside].sum(), slow[inside].sum()), rel=1e-9)
        index, share = cluster_kernels.after_scan(labels, 3, weights, log_ratio)
        assert (index == np.flatnonzero(labels == 3)).all()
        if index.size:
            expected = weights[index] * np.exp(log_ratio[index] - log_ratio[index].max())
            assert share == pytest.approx(expected, rel=1e-9, abs=1e-300)


def _regrouped(
    pose: NDArray[np.float64],
    label: NDArray[np.uint8],
    weight: NDArray[np.float64],
    u: NDArray[np.float64],
    *limits: Any,
) -> Placed:
    choose = cluster_resampling.chooser("systematic", np.random.default_rng(0))
    return cluster_resampling.regroup(Placed(pose, label, weight), u, Limits(*limits), choose)


@pytest.mark.parametrize("name", ["multinomial", "stratified", "csw"])
def test_clusters_are_regrouped_by_any_resampler(name: str) -> None:
    """Weights of the clusters stay, and offspring are in proportion to the weights within one."""
    rng = np.random.default_rng(9)
    poses, labels = rng.normal(0, 1, (3000, 3)), rng.integers(2, 7, 3000).astype(np.uint8)
    poses[:, 2] = np.arange(3000)
    weights = rng.random(3000) ** 4 / 3000
    limits = Limits(2000, 2000, 2000, 0.5, 0.0, 0.5, 0.26, 1e-9)
    choose = cluster_resampling.chooser(name, rng)
    found = cluster_resampling.regroup(Placed(poses, labels, weights), rng.random(7), limits, choose)
    assert cluster_kernels.masses(found.label, found.weight) == pytest.approx(cluster_kernels.masses(labels, weights))
    parents = found.pose[:, 2].astype(int)
    assert (labels[parents] == found.label).all()
    mean = np.array([weights[parents[found.label == k]].mean() for k in range(2, 7)])
    ideal = np.array([(weights[labels == k] ** 2).sum() / weights[labels == k].sum() for k in range(2, 7)])
    assert mean == pytest.approx(
        ideal, rel=0.1
    )  # 2000 offspring a cluster: five standard errors of a spread of about 0.6


def test_regrouping_keeps_each_clusters_weight(assets: Assets) -> None:
    rng = np.random.default_rng(6)
    poses, labels = rng.normal(0, 1, (3000, 3)), rng.integers(2, 7, 3000).astype(np.uint8)
    weights = rng.random(3000) ** 4
    weights /= weights.sum()
    _, new_labels, new_weights = _regrouped(
        poses, labels, weights, rng.random(7), 50, 400, 400, 0.5, 0.05, 0.5, 0.26, 1e-9
    )
    assert cluster_kernels.masses(new_labels, new_weights) == pytest.approx(cluster_kernels.masses(labels, weights))
    assert np.bincount(new_labels).max() <= 400


def test_regrouping_keeps_those_far_apart_and_the_fewest(assets: Assets) -> None:
    rng = np.random.default_rng(8)
    near, far = rng.normal(0, 0.05, (2000, 3)), rng.uniform(-20, 20, (30_000, 3))
    poses, weights = np.concatenate([near, far]), np.r_[np.full(2000, 0.7 / 2000), np.full(30_000, 0.3 / 30_000)]
    kept = (200, 3000, 20_000, 0.5, 0.01, 0.5, 0.26, 1e-9)
    found, _, mass = _regrouped(poses, np.full(32_000, 3, np.uint8), weights, rng.random(7), *kept)
    away = np.hypot(*found[:, :2].T) > 1.0
    assert mass[away].sum() == pytest.approx(0.3, abs=0.01)
    assert away.sum() > 5000  # one hypothesis that is the likelier does not thin out the others
    given_up, _, mass = _regrouped(poses, np.full(32_000, 3, np.uint8), 1e-4 * weights, rng.random(7), *kept)
    assert given_up.shape[0] == 3000  # a place that hardly anything speaks for
    assert mass.sum() == pytest.approx(1e-4)
    for most in (9, 1000):
        few = (200, min(200, most), most, 0.5, 0.01, 0.5, 0.26, 1e-9)
        labels = np.repeat(np.array([3, 5], np.uint8), 16_000)
        _, left, mass = _regrouped(poses, labels, np.full(32_000, 1 / 32_000), rng.random(7), *few)
        assert np.bincount(left)[5] == min(200, most)
        assert mass.sum() == pytest.approx(1.0)


def test_gathering_keeps_what_the_blind_poses_stand_for(assets: Assets) -> None:
    """Weight x likelihood estimates the same integral with and without gathering (many blind poses: a mean of ratios)."""
    rng = np.random.default_rng(7)
    ends = np.array([[0.0, 0.5, -0.5, 1.0, 0.3], [1.03, 1.03, 1.03, -0.97, -0.97]])
    blind = np.column_stack(
        [rng.uniform(1, 5, 40_000), rng.uniform(0.6, 2.4, 40_000), rng.uniform(-np.pi, np.pi, 40_000)]
    )
    params = Params(beam_gain=0.5)
    reading = _reading(0.1, ends)
    likelihood = np.exp(0.5 * likelihood_field.evidence(blind, reading.ends, assets.field))
    ratios = []
    for seed in range(20):
        poses, weights = annealed_sampler.gather(blind, 1.0, 5000, reading, assets, params, np.random.default_rng(seed))
        ratios.append(
            weights @ np.exp(0.5 * likelihood_field.evidence(poses, reading.ends, assets.field)) / likelihood.mean()
        )
    # jittered without a Metropolis step the sampler is slightly biased: a tenth, beside five standard errors
    assert abs(np.mean(ratios) - 1) < 0.1 + 5 * np.std(ratios) / np.sqrt(20)


def test_smoothing_equals_the_sum_over_all_class_paths() -> None:
    rng = np.random.default_rng(8)
    n, steps = 7, 4
    start = rng.random(n)
    start /= start.sum()
    share = rng.random((steps, n, n))
    share /= share.sum(axis=2, keepdims=True)
    likelihood = rng.random((steps, n))
    b = [start]
    history = [class_smoother.Step(np.zeros((n, n)), start)]
    for t in range(steps):
        transition = b[-1][:, None] * share[t]
        predicted = transition.sum(axis=0)
        b.append(predicted * likelihood[t] / (predicted @ likelihood[t]))
        history.append(class_smoother.Step(transition, b[-1]))
    brute = np.zeros((steps + 1, n))
    for path in itertools.product(range(n), repeat=steps + 1):
        p = start[path[0]] * np.prod(
            [share[t, path[t], path[t + 1]] * likelihood[t, path[t + 1]] for t in range(steps)]
        )
        for t, k in enumerate(path):
            brute[t, k] += p
    brute /= brute.sum(axis=1, keepdims=True)
    assert class_smoother.backward(history) == pytest.approx(brute)


def test_crossings_ignore_what_turns_back_halfway() -> None:
    p = np.array([0.9, 0.9, 0.4, 0.6, 0.9, 0.45, 0.1, 0.3, 0.6, 0.95])
    found = class_smoother.crossings(np.arange(10) * 10, p)
    assert [(c["kind"], c["t_ns"]) for c in found] == [("exit", 50), ("entry", 80)]


def _walked(slips: bool, match_scans: bool = True) -> float:
    """Distance of the reckoned pose from the true one after 6 m through a room whose odometry gains 2 % and, perhaps, slips."""
    state, params, error = matched_odometry.Reckoning(), Params(match_scans=match_scans), 0.0
    for k in range(61):
        x = 0.6 + 0.06 * k
        ends = _seen_from(x, 1.5).T
        scan = Beams(np.zeros(2), ends, np.ones(len(ends), np.uint8), np.zeros(len(ends)))
        moved = np.array([0.0612 * (k > 0), 0.0, 0.0])
        if slips and k % 20 == 10:
            moved += [0.2, 0.0, 0.15]
        state, _ = matched_odometry.reckon(state, scan, moved, moved[0], params)
        error = float(np.hypot(state.pose[0] - (x - 0.6), state.pose[1]))
    return error


def test_scans_of_the_last_metres_put_slips_and_scales_of_the_odometry_right() -> None:
    assert _walked(slips=False) < 0.05 < 0.07 < _walked(slips=False, match_scans=False)
    assert _walked(slips=True) < 0.05 < 1.0 < _walked(slips=True, match_scans=False)
    state, moved = matched_odometry.Reckoning(), np.array([0.1, 0.0, 0.02])
    scan = Beams(np.zeros(2), _seen_from(2.0, 1.5).T.copy(), np.ones(90, np.uint8), np.zeros(90))
    for given in (Params(match_scans=False), Params(variant="paper")):
        after, step = matched_odometry.reckon(state, scan, moved, 0.1, given)
        assert after.scans is None
        assert np.array_equal(step, moved)


def _update(
    pose: list[float], found: list[float] | None, way_m: float, fits: bool = True, anew: bool = False
) -> pose_smoother.Reckoned:
    known = np.full(3, np.nan) if found is None else np.array(found)
    return pose_smoother.Reckoned(np.array(pose), fits, anew, False, known, found is not None, way_m)


def test_afterwards_the_way_outside_hangs_between_exit_and_entry() -> None:
    """Reckoning is 0.3 m and 0.2 rad off where the robot comes back: that has come with the way."""
    updates = [_update([0.0, 0.0, 0.0], [1.0, 2.0, np.pi / 2], 0.0)]
    updates += [_update([k, 0.0, 0.0], None, float(k)) for k in (1, 2, 3)]
    updates += [_update([4.0, 0.0, 0.0], [1.3, 6.0, np.pi / 2 + 0.2], 4.0)]
    found = pose_smoother.poses(updates, np.array([1.0, 0.0, 0.0, 0.0, 1.0]))
    assert found[[0, 4]] == pytest.approx(np.array([[1.0, 2.0, np.pi / 2], [1.3, 6.0, np.pi / 2 + 0.2]]))
    for k in (1, 2, 3):
        back = np.array([1.3 + (4 - k) * np.sin(0.2), 6.0 - (4 - k) * np.cos(0.2), np.pi / 2 + 0.2])
        assert found[k] == pytest.approx((1 - k / 4) * np.array([1.0, 2.0 + k, np.pi / 2]) + k / 4 * back)


def test_afterwards_a_robot_that_came_in_late_has_its_way_before_and_none_where_it_was_carried() -> None:
    updates = [_update([k, 0.0, 0.0], None, float(k), k < 1 or k > 2, k == 2) for k in range(4)]
    updates += [_update([4.0, 0.0, 0.0], [7.0, 1.0, 0.0], 4.0), _update([5.0, 0.0, 0.0], None, 5.0)]
    found = pose_smoother.poses(updates, np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0]))
    assert np.isnan(found[:2]).all(), "no scan fitted at the second and third update: it was carried there"
    assert found[2:, 0] == pytest.approx([5.0, 6.0, 7.0, 8.0])
    again = [u._replace(anew=False) for u in updates]
    assert pose_smoother.poses(again, np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0]))[:, 0] == pytest.approx(
        np.arange(3.0, 9.0)
    )
    assert np.isnan(pose_smoother.poses(updates[:2], np.zeros(2))).all()
    lost = [u._replace(fits=True, anew=False, lost=0 < k < 4) for k, u in enumerate(updates)]
    found = pose_smoother.poses(lost, np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0]))
    assert np.isnan(found[:1]).all()
    assert found[1:, 0] == pytest.approx([4.0, 5.0, 6.0, 7.0, 8.0]), "it got lost once, at the second update"


def _driven(stays: list[tuple[int, float]]) -> tuple[list[pose_smoother.Reckoned], np.ndarray]:
    """Updates every metre along x, found `off` metres beside where they are for so many metres each; nan: not found."""
    updates, k = [], 0
    for metres, off in stays:
        for _ in range(metres):
            updates.append(_update([float(k), 0.0, 0.0], None if np.isnan(off) else [k + 10.0, off, 0.0], float(k)))
            k += 1
    return updates, np.array([1.0 if u.sure else 0.0 for u in updates])


def test_afterwards_a_wrong_place_is_taken_back_where_the_others_contradict_it() -> None:
    for stays in (
        [(4, 6.0), (3, np.nan), (8, 0.0)],
        [(8, 0.0), (2, 5.0), (6, 0.0)],
        [(9, 0.0), (5, np.nan), (3, 7.0)],
    ):
        found = pose_smoother.poses(*_driven(stays))
        assert found[:, 1] == pytest.approx(np.zeros(len(found)), abs=1e-9)
        assert found[:, 0] == pytest.approx(np.arange(len(found)) + 10.0)


def test_afterwards_places_that_both_lasted_are_both_right() -> None:
    updates, in_map = _driven([(15, 0.0), (4, np.nan), (15, 9.0)])
    found = pose_smoother.poses(updates, in_map)
    assert found[:19, 1] == pytest.approx(np.zeros(19))
    assert found[19:, 1] == pytest.approx(np.full(15, 9.0))


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_a_map_is_extended_beyond_its_edge_and_nowhere_else(yaw: float) -> None:
    rng = np.random.default_rng(3)
    cells = rng.integers(-1, 2, (40, 50)).astype(np.int8)
    grid = GridMap(cells, 0.1, Pose2(1.0, -2.0, yaw))
    more = GridMap(rng.integers(-1, 2, (60, 70)).astype(np.int8), 0.1, Pose2(-1.5, -3.0, 0.0))
    found = map_extension.merged(grid, more)
    assert found.origin.yaw_rad == yaw
    c, s = np.cos(yaw), np.sin(yaw)

    def value(of: GridMap, x: float, y: float) -> int:
        dx, dy = x - of.origin.x_m, y - of.origin.y_m
        cy, sy = np.cos(of.origin.yaw_rad), np.sin(of.origin.yaw_rad)
        col, row = int(np.floor((cy * dx + sy * dy) / 0.1)), int(np.floor((cy * dy - sy * dx) / 0.1))
        inside = 0 <= row < of.cells.shape[0] and 0 <= col < of.cells.shape[1]
        return int(of.cells[row, col]) if inside else -1

    low = round((c * (found.origin.x_m - 1.0) + s * (found.origin.y_m + 2.0)) / 0.1)
    left = round((c * (found.origin.y_m + 2.0) - s * (found.origin.x_m - 1.0)) / 0.1)
    assert (
        found.cells[-left:, -low:][:40, :50] == np.where(cells == -1, found.cells[-left:, -low:][:40, :50], cells)
    ).all()
    for row, col in rng.integers(0, found.cells.shape, (300, 2)):
        x = found.origin.x_m + 0.1 * (c * (col + 0.5) - s * (row + 0.5))
        y = found.origin.y_m + 0.1 * (s * (col + 0.5) + c * (row + 0.5))
        mine = value(grid, x, y)
        assert found.cells[row, col] == (mine if mine != -1 else value(more, x, y))
    assert map_extension.extended(grid, [], np.empty((0, 3))) is grid


def test_the_sample_afterwards_is_known_outside_too_and_draws_what_lies_there() -> None:
    done, there = _sample("partial", "unknown", extend_map=True)
    track = done.result.track
    error = np.hypot(track.columns["x_smoothed_m"] - there[:, 0], track.columns["y_smoothed_m"] - there[:, 1])
    outside = there[:, 0] > 12.5
    assert outside.sum() > 50
    assert error[outside].max() < 0.25
    given, found = done.result.grid, done.result.layers["extended"]
    assert given is not None
    whole = rasterize(WORLDS["partial-leave"](1), 0.05)
    row, col = np.nonzero(found.cells == 1)
    x, y = found.origin.x_m + 0.05 * (col + 0.5), found.origin.y_m + 0.05 * (row + 0.5)
    beyond = x > 12.3
    away = distance_m(whole.cells == 1, 0.05)
    at = away[((y - whole.origin.y_m) / 0.05).astype(int), ((x - whole.origin.x_m) / 0.05).astype(int)]
    assert beyond.sum() > 300
    assert np.quantile(at[beyond], 0.95) <= 0.15
    assert (found.cells >= 0).sum() > 1.2 * (given.cells >= 0).sum()


def _sample(name: str, initial: str, **params: Any) -> tuple[loop.Run, np.ndarray]:
    """A run on a sample log, and the true poses at the stamps of its track."""
    folder = Path(__file__).parents[2] / "sample_logs"
    log, grid = folder / f"{name}.mcap", folder / ("partial-partial.yaml" if name == "partial" else f"{name}.yaml")
    done = loop.execute(
        loop.Job(system("localize-partial"), Params(**params), [log], map=grid, initial=Initial(initial))
    )
    truth = list(Log(log).events(["truth"]))
    at, true = np.array([e.stamp_ns for e in truth]), np.array([e[1:4] for e in truth])
    return done, track_error.interpolate(done.result.track.stamps_ns, at, true)


def test_a_robot_that_was_said_to_be_outside_is_found_in_the_map_within_four_metres() -> None:
    """The scans of the last metres speak for its place too, once that is looked at: without them it takes 30 m."""
    done, there = _sample("partial", "outside", smooth=False)
    track = done.result.track
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(there[:, :2], axis=0).T))])
    right = np.hypot(*(track.poses - there)[:, :2].T) < 0.3
    assert way[right][0] < 4.0


def test_afterwards_a_carried_robot_has_its_way_back_to_where_it_got_lost_and_not_across() -> None:
    done, there = _sample("kidnapped", "inside")
    track = done.result.track
    carried = int(np.argmax(np.hypot(*np.diff(there[:, :2], axis=0).T))) + 1
    error = np.hypot(track.columns["x_smoothed_m"] - there[:, 0], track.columns["y_smoothed_m"] - there[:, 1])
    found = int(np.flatnonzero(np.isfinite(track.poses[carried + 30 :, 0]))[0]) + carried + 30
    assert error[: carried - 5].max() < 0.1
    assert error[found + 5 :].max() < 0.1
    known = np.isfinite(error[carried + 40 : found])
    assert known.any()
    assert error[carried + 40 : found][known].max() < 0.1
    lost = ~np.isfinite(track.poses[carried:, 0])
    assert lost.sum() > 10, "nobody knows where it is for a while, and no pose outside is said"


@pytest.mark.parametrize("carried", [0.0, 0.001])
def test_without_the_outside_likelihood_scans_leave_class_1_alone(carried: float, assets: Assets) -> None:
    params = Params(outside_likelihood=False, kidnap_per_m=carried, frontier_samples=500, beam_gain=0.3)
    before = Belief(np.empty((0, 3)), np.empty(0, np.uint8), np.empty(0), np.array([0.3, 0.7, 0, 0, 0, 0, 0]))
    for k in range(12):
        reading = _reading(0.0, _seen_from(2.0, 1.5))
        past = (Past(np.zeros(3), *reading[2:5], 0.0),) * 5
        before = update_corrected.update(before, reading._replace(stamp_ns=k, past=past), assets, params, Draw(0))
        assert before.b.sum() == pytest.approx(1.0)
    assert before.b[1] == pytest.approx(0.7, abs=1e-9)


@pytest.mark.parametrize(
    ("initial", "missed"),
    [
        (Initial("unknown"), 0.05),
        (Initial("inside"), 0.1),
        (Initial("outside"), 0.0),
        (Initial("inside", heading=(0.0, 0.1)), 0.0),
        (Initial("region", region=Path("there.yaml")), 0.0),
        (Initial("pose", (3.0, 1.5, 0.0)), 0.0),
    ],
)
def test_only_a_start_that_may_be_anywhere_may_be_missed(initial: Initial, missed: float, assets: Assets) -> None:
    """What is said of the start holds: nobody is looked for beyond it."""
    first: Any = SimpleNamespace(stamp_ns=5, odometry=(0.0, 0.0, 0.0))
    told = assets._replace(initial=initial)
    assert filter.init(Params(particles=300, start_density_per_m2=1.0), told, first, Draw(0)).belief.b[0] == missed
    printed = filter.init(Params(particles=300, start_density_per_m2=1.0, variant="paper"), told, first, Draw(0))
    assert printed.belief.b[0] == 0.0
