"""Landmarks: evidence against a plain sum, and poses from two of them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core.sensor import known_landmarks
from pfcli.core.sensor.known_landmarks import Detections

PLACES = np.array([[9.0, 1.0], [9.0, -1.0], [-9.0, 1.0], [-9.0, -1.0], [0.0, 0.0]])
START = np.array([0, 4, 8, 9])


def detected(pose: np.ndarray, which: tuple[int, int, int]) -> Detections:
    """A left and a right post and the circle, each of its kind's places."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    d = PLACES[list(which)] - pose[:2]
    seen = np.column_stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]])
    return Detections(seen, np.vstack([PLACES[:4], PLACES[:4], PLACES[4:]]), START, np.array([0.1, 0.1, 0.2]))


def test_evidence_is_the_sum_over_detections_of_the_nearest_place() -> None:
    pose = np.array([4.0, 1.0, 0.3])
    found = detected(pose, (0, 1, 4))
    for at in (pose, pose + np.array([0.2, -0.1, 0.05])):
        expected = 0.0
        for k in range(3):
            c, s = math.cos(at[2]), math.sin(at[2])
            x, y = (
                at[0] + c * found.seen_m[k, 0] - s * found.seen_m[k, 1],
                at[1] + s * found.seen_m[k, 0] + c * found.seen_m[k, 1],
            )
            places = found.places_m[START[k] : START[k + 1]]
            v = found.sigma_m[k] ** 2
            nearest = ((places - [x, y]) ** 2).sum(axis=1).min()
            expected += math.log(0.8 * 216.0 / (2 * math.pi * v) * math.exp(-0.5 * nearest / v) + 0.2)
        assert known_landmarks.evidence(at[None], found, 0.8, 216.0)[0] == pytest.approx(expected)
    assert known_landmarks.best_evidence(found, 0.8, 216.0) == pytest.approx(
        known_landmarks.evidence(pose[None], found, 0.8, 216.0)[0]
    )


@given(st.floats(-8, 8), st.floats(-5, 5), st.floats(-3.1, 3.1))
def test_two_known_landmarks_give_the_pose(x: float, y: float, yaw: float) -> None:
    pose = np.array([x, y, yaw])
    places = ((9.0, 1.0), (0.0, 0.0))
    if min(math.hypot(x - p[0], y - p[1]) for p in places) < 0.1:
        return
    c, s = math.cos(yaw), math.sin(yaw)
    d = np.array(places) - pose[:2]
    found = known_landmarks.two_landmarks(
        places, np.column_stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]])
    )
    assert found is not None
    assert found[:2] == pytest.approx((x, y), abs=1e-4)
    assert math.remainder(found[2] - yaw, 2 * math.pi) == pytest.approx(0.0, abs=1e-4)


def test_ranges_of_circles_that_miss_each_other_give_nothing() -> None:
    assert known_landmarks.two_ranges((0.0, 0.0), (4.0, 0.0), 1.0, 1.0) == []
    assert known_landmarks.two_ranges((0.0, 0.0), (0.0, 0.0), 1.0, 1.0) == []
    assert len(known_landmarks.two_ranges((0.0, 0.0), (4.0, 0.0), 3.0, 3.0)) == 2


def test_the_poses_of_pairs_hold_the_true_one_and_its_mirror_image_and_refining_keeps_it() -> None:
    pose = np.array([4.0, 1.0, 0.3])
    found = detected(pose, (0, 1, 4))
    poses = known_landmarks.pair_poses(found, 1000)
    for wanted in (pose, np.array([-4.0, -1.0, 0.3 - math.pi])):
        off = np.hypot(*(poses[:, :2] - wanted[:2]).T)
        assert off.min() < 1e-6
    refined, hessian = known_landmarks.refine(pose[None] + [[0.1, -0.1, 0.02]], found)
    assert np.allclose(refined[0], pose, atol=0.02)
    assert np.linalg.eigvalsh(hessian[0]).min() > 1.0
