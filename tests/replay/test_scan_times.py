"""Beams that were measured while the robot moved."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.dropped import Dropped
from pfcli.events import Odometry, Pose2, Scan
from pfcli.replay.align import sweeps
from pfcli.replay.settings import Deskew, Drive

S = 1_000_000_000
N = 180
WALLS = (4.0, -3.0, 2.5, -5.0)


def pose(t: float) -> np.ndarray:
    """An arc, turning 1.5 rad/s."""
    return np.array(
        [0.4 / 1.5 * math.sin(1.5 * t), 0.4 / 1.5 * (1 - math.cos(1.5 * t)), math.remainder(3.0 + 1.5 * t, 2 * math.pi)]
    )


def wall(sensor: np.ndarray, angle: float) -> float:
    d = math.cos(sensor[2] + angle), math.sin(sensor[2] + angle)
    far = [(w - sensor[k // 2]) / d[k // 2] for k, w in enumerate(WALLS)]
    return min(f for f in far if f > 0)


def scan_at(t: float, times: np.ndarray, mount: Pose2, **told: Any) -> Scan:
    """What is measured when beam k is sent at t + times[k]."""
    step = 2 * math.pi / N
    ranges = np.empty(N, np.float32)
    for k in range(N):
        p = pose(t + times[k])
        c, s = math.cos(p[2]), math.sin(p[2])
        at = np.array([p[0] + c * mount[0] - s * mount[1], p[1] + s * mount[0] + c * mount[1], p[2] + mount[2]])
        ranges[k] = wall(at, -math.pi + k * step)
    return Scan(round(t * S), ranges, -math.pi, step, 0.05, 30.0, mount)._replace(**told)


def off(scan: Scan, t: float) -> float:
    """How far end points lie off the walls, seen from the true pose at the stamp (m)."""
    a, r, p = scan.directions_rad(), scan.ranges_m.astype(float), pose(t)
    x, y = scan.mount.x_m + r * np.cos(a), scan.mount.y_m + r * np.sin(a)
    c, s = math.cos(p[2]), math.sin(p[2])
    wx, wy = p[0] + c * x - s * y, p[1] + s * x + c * y
    return float(
        np.minimum.reduce([abs(wx - WALLS[0]), abs(wx - WALLS[1]), abs(wy - WALLS[2]), abs(wy - WALLS[3])]).max()
    )


def replayed(scan: Scan, deskew: Deskew, dropped: Dropped | None = None) -> Scan:
    """Odometry of 100 Hz around one scan."""
    motion: list[Any] = [Odometry(k * S // 100, *pose(k / 100).tolist()) for k in range(150)]
    events = sorted([*motion, scan], key=lambda e: (e.stamp_ns, isinstance(e, Scan)))
    (sweep,) = sweeps(events, "odometry", Drive(), Dropped() if dropped is None else dropped, deskew=deskew)
    assert sweep.odometry[:2] == pytest.approx(pose(scan.stamp_ns / S)[:2], abs=1e-3)
    return sweep.scan  # type: ignore[union-attr]


MOUNT = Pose2(0.2, -0.1, 0.4)


@given(st.sampled_from(["first", "middle", "last"]), st.sampled_from([0.05, 0.1, 0.18]), st.booleans())
def test_every_beam_ends_where_it_was_measured(stamp: str, period: float, said: bool) -> None:
    """An arc between two odometry messages is taken straight: 0.4 m/s over 10 ms, and half a beam's rounding."""
    times = np.linspace(0.0, period, N) - {"first": 0.0, "middle": period / 2, "last": period}[stamp]
    told = {} if said else {"time_increment_s": period / (N - 1), "scan_time_s": period}
    scan = scan_at(0.71, times, MOUNT, **told)
    assert off(scan, 0.71) > 0.1
    assert off(replayed(scan, Deskew(True, period if said else None, stamp)), 0.71) < 2e-3
    assert off(replayed(scan, Deskew(False)), 0.71) > 0.1


def test_a_scan_in_one_instant_is_left_as_it_is() -> None:
    scan = scan_at(0.5, np.zeros(N), MOUNT)
    assert replayed(scan, Deskew()) is scan


def test_times_between_beams_that_cannot_be_are_found() -> None:
    scan = scan_at(0.5, np.zeros(N), MOUNT, time_increment_s=0.4 / N, scan_time_s=0.1)
    dropped = Dropped()
    assert replayed(scan, Deskew(), dropped) is scan
    assert "0.398 s, and scan_time is 0.1 s" in dropped.found[0].seen


def test_no_return_stays_none_and_what_is_no_measurement_too() -> None:
    scan = scan_at(0.5, np.linspace(0, 0.1, N), MOUNT, time_increment_s=0.1 / (N - 1))
    ranges = scan.ranges_m.copy()
    ranges[:3] = (np.inf, 31.0, 0.01)
    seen = replayed(scan._replace(ranges_m=ranges), Deskew())
    assert np.isinf(seen.ranges_m[:2]).all()
    assert math.isnan(seen.ranges_m[2])
