"""From a scan to points in the base frame: what returned, what did not, and what is no measurement at all."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.tiles import Beams
from pfcli.core.jit import kernel
from pfcli.events import EVENLY


class Points(NamedTuple):
    """ends (b, 2) of the beams that returned, in beam order; far (k, 2), ends of the cleared part of the others;
    returns, no_returns, invalid: counts; skip (b,): see `Beams`."""

    ends: NDArray[np.float64]
    far: NDArray[np.float64]
    skip: NDArray[np.float64]
    no_returns: int
    invalid: int


@kernel
def _points(ranges, angle_min, increment, low, high, mount, stride, clear_m, cell_m, own):
    n = ranges.size
    ends, far, skip = np.empty((n, 2)), np.empty((n, 2)), np.empty(n)
    count, none, rest, invalid = 0, 0, 0, 0
    spacing = abs(increment) * stride
    for k in range(0, n, stride):
        r = np.float64(ranges[k])
        # no return: beyond the usable range or +inf; invalid: NaN, negative, zero, nearer than the sensor can see
        if not r > low or r <= 0.0:
            invalid += 1
            continue
        angle = mount[2] + angle_min + k * increment if own.size == 0 else mount[2] + own[k]
        cos, sin = np.cos(angle), np.sin(angle)
        if r >= high:
            none += 1
            if clear_m > 0.0:
                far[rest, 0], far[rest, 1] = mount[0] + cos * clear_m, mount[1] + sin * clear_m
                rest += 1
            continue
        ends[count, 0], ends[count, 1] = mount[0] + cos * r, mount[1] + sin * r
        # near the sensor neighbouring beams cross the same cells: every second, fourth, eighth beam is enough there
        index, crowd = k // stride, 1
        while crowd < 8 and index % (2 * crowd) == 0:
            crowd *= 2
        start = 0.0 if crowd == 8 or spacing == 0.0 else 0.5 * cell_m / (spacing * crowd)
        skip[count] = min(1.0, start / r)
        count += 1
    return ends[:count], far[:rest], skip[:count], none, invalid


def points_of(
    ranges_m: NDArray[np.floating],
    angles: tuple[float, float],
    limits_m: tuple[float, float],
    mount: tuple[float, float, float],
    stride: int,
    clear_m: float,
    cell_m: float,
    bearings_rad: NDArray[np.float64] = EVENLY,
) -> Points:
    """Points of a scan whose beam k points at angles[0] + k angles[1] (rad, sensor frame), or at bearings_rad[k].

    limits_m: usable ranges; stride: every stride-th beam; clear_m: how far beams without a return clear (0: not).
    """
    ranges = np.array(ranges_m, np.float64)
    ends, far, skip, none, invalid = _points(
        ranges, *angles, *limits_m, np.array(mount, np.float64), stride, clear_m, cell_m, bearings_rad
    )
    return Points(ends, far, skip, none, invalid)


def beams_of(points: Points, mount: tuple[float, float, float]) -> Beams:
    """The scan as what is drawn into a map: points (b, 2) in the base frame (m), those that hit first."""
    k = points.far.shape[0]
    hit = np.ones(points.skip.size + k, np.uint8)
    hit[points.skip.size :] = 0
    return Beams(
        np.array(mount[:2], np.float64),
        np.concatenate([points.ends, points.far]),
        hit,
        np.concatenate([points.skip, np.zeros(k)]),
    )
