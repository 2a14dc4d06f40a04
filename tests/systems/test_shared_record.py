"""What all filters share of an update: when one is due, what of a scan is used, when particles are drawn anew."""

import math
from types import SimpleNamespace

import numpy as np

from pfcli.core.estimate import PoseEstimate
from pfcli.events import Pose2, Scan, Sweep
from pfcli.rng import Draw
from pfcli.systems.shared import resampling
from pfcli.systems.shared.motion_gate import update_of
from pfcli.systems.shared.run_record import RunRecord
from pfcli.systems.shared.usable_points import usable_points

PARAMS = SimpleNamespace(update_distance_m=0.1, update_angle_rad=0.1, max_range_m=0.0)
HERE = PoseEstimate(np.zeros(3), np.diag([0.09, 0.16, 0.04]), 1.0)


def _sweep(k: int, x: float, ranges: list[float]) -> Sweep:
    scan = Scan(
        stamp_ns=k,
        ranges_m=np.array(ranges, np.float32),
        angle_min_rad=0.0,
        angle_increment_rad=0.1,
        range_min_m=0.05,
        range_max_m=10.0,
        mount=Pose2(0.0, 0.0, 0.0),
    )
    return Sweep(k, (x, 0.0, 0.0), scan, "")


def test_the_first_usable_scan_and_those_after_a_way_update_and_all_get_a_pose() -> None:
    record, last, updated = RunRecord(), np.zeros((1, 3)), []
    readings = [(0.0, [math.inf]), (0.0, [1.0]), (0.05, [1.0]), (0.12, [math.nan]), (0.14, [1.0])]
    for k, (x, ranges) in enumerate(readings):
        update = update_of(record, last, _sweep(k, x, ranges), PARAMS, usable_points)
        if update is None:
            continue
        updated.append((k, update.first, round(update.step.way_m, 9)))
        last = update.step.now
        record.report(HERE, np.zeros((3, 3)), update.used.ends)
    assert updated == [(1, True, 0.0), (4, False, 0.14)]
    assert record.updates == 2
    assert record.poses().stamps_ns.tolist() == [1, 2, 3, 4]
    assert [f.stamp_ns for f in record.frames()] == [1, 4]


def test_spreads_of_an_estimate_are_roots_of_its_covariance() -> None:
    assert math.isclose(HERE.sd_m, 0.5)
    assert math.isclose(HERE.sd_yaw_rad, 0.2)


def test_every_kth_beam_is_used_where_there_are_many() -> None:
    points = usable_points(_sweep(0, 0.0, [1.0] * 10), PARAMS, most_beams=4)
    assert points is not None
    assert points.ends.shape == (4, 2)  # each third of ten


def test_even_weights_are_resampled_only_as_printed_or_in_a_crowd() -> None:
    even, uneven = np.full(10, 0.1), np.r_[0.91, np.full(9, 0.01)]
    for weights, n_eff, variant, particles, expected in (
        (even, 10.0, "corrected", 10, False),
        (even, 10.0, "corrected", 8, True),
        (even, 10.0, "paper", 10, True),
        (uneven, 1.2, "corrected", 10, True),
    ):
        params = SimpleNamespace(variant=variant, particles=particles, resample_threshold=0.5, resampler="systematic")
        chosen = resampling.chosen(weights, n_eff, params, Draw(0), 5)
        assert (chosen is not None) == expected
        assert chosen is None or chosen.size == particles
