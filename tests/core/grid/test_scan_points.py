import numpy as np
import pytest

from pfcli.core.grid.scan_points import points_of


def test_beams_are_told_apart() -> None:
    ranges = np.array([1.0, np.inf, np.nan, -1.0, 0.0, 30.0, 2.0, 0.05])
    points = points_of(ranges, (0.0, 0.1), (0.1, 10.0), (0.0, 0.0, 0.0), 1, 0.0, 0.05)
    assert points.ends.shape == (2, 2)
    assert (points.no_returns, points.invalid) == (2, 4)
    assert points.ends[0] == pytest.approx([1.0, 0.0])


def test_a_mounted_laser_sees_from_where_it_sits() -> None:
    points = points_of(np.array([2.0]), (0.0, 0.0), (0.0, 10.0), (0.3, -0.1, np.pi / 2), 1, 0.0, 0.05)
    assert points.ends[0] == pytest.approx([0.3, 1.9])


def test_beams_without_return_clear_only_if_asked() -> None:
    ranges = np.array([np.inf, 1.0])
    assert points_of(ranges, (0.0, 0.1), (0.0, 10.0), (0.0, 0.0, 0.0), 1, 0.0, 0.05).far.size == 0
    far = points_of(ranges, (0.0, 0.1), (0.0, 10.0), (0.0, 0.0, 0.0), 1, 4.0, 0.05).far
    assert far[0] == pytest.approx([4.0, 0.0])
