"""Landmarks of a known map: how well detections fit a pose, and positions from two of them."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import kernel


class Detections(NamedTuple):
    """What was detected, seen (m, 2) in the base frame; the places that each can be: places (c, 2), rows start[k] to
    start[k + 1] of the k-th; sigma (m,) spread of each (m)."""

    seen_m: NDArray[np.float64]
    places_m: NDArray[np.float64]
    start: NDArray[np.int64]
    sigma_m: NDArray[np.float64]


@kernel
def _evidence(poses, seen, places, start, sigma, hit, area, out):  # type: ignore[no-untyped-def]
    for i in range(poses.shape[0]):
        c, s, total = np.cos(poses[i, 2]), np.sin(poses[i, 2]), 0.0
        for k in range(seen.shape[0]):
            x = poses[i, 0] + c * seen[k, 0] - s * seen[k, 1]
            y = poses[i, 1] + s * seen[k, 0] + c * seen[k, 1]
            best = np.inf
            for j in range(start[k], start[k + 1]):
                dx, dy = x - places[j, 0], y - places[j, 1]
                best = min(best, dx * dx + dy * dy)
            v = sigma[k] * sigma[k]
            total += np.log(hit * area / (2 * np.pi * v) * np.exp(-0.5 * best / v) + 1.0 - hit)
        out[i] = total


def evidence(poses: NDArray[np.float64], detections: Detections, hit: float, area_m2: float) -> NDArray[np.float64]:
    """Sum (n,) over the detections of log p(detection | pose) / p(detection | nowhere), the nearest place taken for each.

    hit: share of detections that are what they seem; area_m2: over which the others lie.
    """
    out = np.empty(poses.shape[0])
    _evidence(poses, detections.seen_m, detections.places_m, detections.start, detections.sigma_m, hit, area_m2, out)
    return out


def two_ranges(
    a: tuple[float, float], b: tuple[float, float], range_a_m: float, range_b_m: float
) -> list[tuple[float, float]]:
    """The positions with these ranges to two known places: two, or one where the circles only just miss each other.

    Zhang 2011, section 2.2. None where the places coincide or the circles are apart by more than a tenth of their distance.
    """
    dx, dy = b[0] - a[0], b[1] - a[1]
    apart = math.hypot(dx, dy)
    if apart < 1e-6:
        return []
    along = (range_a_m**2 - range_b_m**2 + apart**2) / (2 * apart)
    square = range_a_m**2 - along**2
    foot = a[0] + along * dx / apart, a[1] + along * dy / apart
    if square <= 0.0:
        return [foot] if square > -((0.1 * apart) ** 2) else []
    off = math.sqrt(square)
    return [(foot[0] - s * off * dy / apart, foot[1] + s * off * dx / apart) for s in (1.0, -1.0)]


def two_landmarks(
    places: tuple[tuple[float, float], tuple[float, float]], seen: NDArray[np.float64]
) -> tuple[float, float, float] | None:
    """The pose (m, m, rad) from two known places and where they were seen (2, 2; base frame, m): of the two positions with
    these ranges, the one from which the bearings agree. None where there is none."""
    ranges = np.hypot(seen[:, 0], seen[:, 1])
    best, pose = math.pi / 2, None
    for x, y in two_ranges(*places, float(ranges[0]), float(ranges[1])):
        turns = [
            math.atan2(p[1] - y, p[0] - x) - math.atan2(s[1], s[0]) for p, s in zip(places, seen.tolist(), strict=True)
        ]
        apart = math.remainder(turns[1] - turns[0], 2 * math.pi)
        if abs(apart) < best:
            best, pose = abs(apart), (x, y, math.remainder(turns[0] + apart / 2, 2 * math.pi))
    return pose
