"""Odometry from scans against the map of the way just behind."""

import numpy as np
import pytest

from pfcli.core.geometry import between, compose
from pfcli.core.grid.coarse_search import Window
from pfcli.core.grid.scan_match import Matcher
from pfcli.core.grid.scan_odometry import WAY_M, ScanOdometry, Setup
from pfcli.core.grid.tiles import Beams
from pfcli.core.motion.odometry import Noise

NOISE = Noise(0.1, 0.02, 0.005, 0.1, 0.05, 0.003)
SETUP = Setup(Matcher(map_normals=True, tangent=0.0), Window(0.3, 0.35, 0.15, 0.035, 0.12, 50, 0.005), NOISE, 0.05, 0.5)
ROOM = ((-2.0, -2.0), (14.0, 5.0))


def _seen(pose: np.ndarray, crowd: bool = False) -> Beams:
    """A room of 16 x 7 m, noise-free, from a pose; crowd: a third of the beams end at people who walk along."""
    angles = pose[2] + np.linspace(-3.1, 3.1, 240)
    cos, sin = np.cos(angles), np.sin(angles)
    (x0, y0), (x1, y1) = ROOM
    with np.errstate(divide="ignore"):
        along = np.where(cos > 0, (x1 - pose[0]) / cos, (x0 - pose[0]) / cos)
        across = np.where(sin > 0, (y1 - pose[1]) / sin, (y0 - pose[1]) / sin)
    ranges = np.minimum(along, across)
    if crowd:
        ranges[::3] = 1.5
    ends = np.stack([ranges * np.cos(angles - pose[2]), ranges * np.sin(angles - pose[2])], axis=1)
    return Beams(np.zeros(2), ends, np.ones(len(ends), np.uint8), np.zeros(len(ends)))


def _driven(spoil: np.ndarray, at: int = -1, crowd: bool = False) -> tuple[np.ndarray, ScanOdometry]:
    """Largest errors (m, rad) over 9 m of an arc, with an odometry whose step `at` (every step: -1) is spoilt."""
    step = np.array([0.1, 0.0, 0.02])
    pose = np.zeros(3)
    found = ScanOdometry(SETUP, _seen(pose, crowd), pose)
    worst = np.zeros(2)
    for k in range(90):
        pose = compose(pose[None], (step * [1.0, 1.0, np.cos(0.1 * k)])[None])[0]
        read = step * [1.0, 1.0, np.cos(0.1 * k)] + (spoil if at in (-1, k) else 0.0)
        found.step(_seen(pose, crowd), read, 0.1, NOISE)
        off = between(pose[None], found.pose[None])[0]
        worst = np.maximum(worst, [np.hypot(off[0], off[1]), abs(off[2])])
    return worst, found


@pytest.mark.parametrize("crowd", [False, True])
def test_scans_hold_the_pose_where_odometry_is_wrong_in_every_step(crowd: bool) -> None:
    error, _ = _driven(np.array([0.004, 0.002, 0.003]), crowd=crowd)  # 0.4 m and 0.27 rad by odometry alone
    assert error[0] < 0.05
    assert error[1] < 0.01


def test_a_slip_is_seen_at_once() -> None:
    error, _ = _driven(np.array([0.25, -0.1, 0.2]), at=50)
    assert error[0] < 0.05
    assert error[1] < 0.01


def test_a_scan_that_contradicts_the_last_metres_is_not_drawn_and_says_so() -> None:
    _, found = _driven(np.zeros(3))
    scan = _seen(np.array([6.0, 0.0, 0.0]))
    elsewhere = scan._replace(ends=scan.ends * 0.4 + np.array([0.0, 0.2]))
    assert not found.step(elsewhere, np.array([0.1, 0.0, 0.0]), 0.1, NOISE).fits


def test_maps_of_the_way_behind_are_given_up_after_twice_their_length() -> None:
    _, found = _driven(np.zeros(3))
    assert found._way_m - found._since_m <= 2 * WAY_M
    assert found._since_m >= WAY_M / 2
