"""Landmarks of a known map: how well detections fit a pose, and positions from two of them."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import cholesky3, solve3, wrap
from pfcli.core.jit import kernel


class Detections(NamedTuple):
    """What was detected, seen (m, 2) in the base frame; the places that each can be: places (c, 2), rows start[k] to
    start[k + 1] of the k-th; sigma (m,) spread of each (m)."""

    seen_m: NDArray[np.float64]
    places_m: NDArray[np.float64]
    start: NDArray[np.int64]
    sigma_m: NDArray[np.float64]


@kernel
def _evidence(poses, seen, places, start, sigma, hit, area, out):
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


def best_evidence(detections: Detections, hit: float, area_m2: float) -> float:
    """Evidence of detections that all stand exactly where they should."""
    peak = hit * area_m2 / (2 * np.pi * detections.sigma_m**2)
    return float(np.log(peak + 1.0 - hit).sum())


_STEPS, _GATE, _LOOSE = 6, 4.0, 1.0


@kernel
def _refine(poses, seen, places, start, sigma, hessian):
    low, g, move = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    for i in range(poses.shape[0]):
        h = hessian[i]
        for _ in range(_STEPS):
            h[:] = 0.0
            g[:] = 0.0
            for k in range(3):
                h[k, k] = _LOOSE
            c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
            for k in range(seen.shape[0]):
                ox, oy = c * seen[k, 0] - s * seen[k, 1], s * seen[k, 0] + c * seen[k, 1]
                best, ex, ey = np.inf, 0.0, 0.0
                for j in range(start[k], start[k + 1]):
                    dx, dy = poses[i, 0] + ox - places[j, 0], poses[i, 1] + oy - places[j, 1]
                    if dx * dx + dy * dy < best:
                        best, ex, ey = dx * dx + dy * dy, dx, dy
                v = sigma[k] * sigma[k]
                if best > _GATE * _GATE * max(v, 0.04):
                    continue
                h[0, 0] += 1.0 / v
                h[1, 1] += 1.0 / v
                h[0, 2] -= oy / v
                h[1, 2] += ox / v
                h[2, 2] += (ox * ox + oy * oy) / v
                g[0] += ex / v
                g[1] += ey / v
                g[2] += (ox * ey - oy * ex) / v
            h[2, 0], h[2, 1] = h[0, 2], h[1, 2]
            cholesky3(h, low)
            solve3(low, g, move)
            for m in range(3):
                poses[i, m] -= move[m]
        poses[i, 2] = wrap(poses[i, 2])


def refine(poses: NDArray[np.float64], detections: Detections) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses (k, 3) moved to where detections stand on their nearest places, and the Hessian (k, 3, 3) of the error there;
    detections far from any place are left out."""
    out, hessian = poses.copy(), np.empty((poses.shape[0], 3, 3))
    _refine(out, detections.seen_m, detections.places_m, detections.start, detections.sigma_m, hessian)
    return out, hessian


@kernel
def _pairs(seen, places, start, sigma, out):
    count = 0
    for i in range(seen.shape[0]):
        for j in range(i):
            sx, sy = seen[i, 0] - seen[j, 0], seen[i, 1] - seen[j, 1]
            far = np.hypot(sx, sy)
            for a in range(start[i], start[i + 1]):
                for b in range(start[j], start[j + 1]):
                    px, py = places[a, 0] - places[b, 0], places[a, 1] - places[b, 1]
                    apart = np.hypot(px, py)
                    if apart < 0.1 or abs(apart - far) > 3.0 * (sigma[i] + sigma[j]) or count == out.shape[0]:
                        continue
                    turn = np.arctan2(py, px) - np.arctan2(sy, sx)
                    c, s = np.cos(turn), np.sin(turn)
                    mx, my = (seen[i, 0] + seen[j, 0]) / 2, (seen[i, 1] + seen[j, 1]) / 2
                    out[count, 0] = (places[a, 0] + places[b, 0]) / 2 - c * mx + s * my
                    out[count, 1] = (places[a, 1] + places[b, 1]) / 2 - s * mx - c * my
                    out[count, 2] = wrap(turn)
                    count += 1
    return count


def pair_poses(detections: Detections, most: int) -> NDArray[np.float64]:
    """Poses (c, 3), at most `most`, from which two detections are as far apart as two of their places are."""
    out = np.empty((most, 3))
    count = _pairs(detections.seen_m, detections.places_m, detections.start, detections.sigma_m, out)
    return out[:count]


def triangulated(detections: Detections, near: NDArray[np.float64]) -> tuple[float, float, float] | None:
    """The pose from the two detections that stand farthest apart in angle, each taken for the place of its kind that is
    nearest from the pose `near` (3,). Zhang 2011, section 2.2."""
    seen, places, start, _ = detections
    c, s = math.cos(near[2]), math.sin(near[2])
    at = near[:2] + seen @ np.array([[c, s], [-s, c]])
    known = [
        places[a + int(np.argmin(((places[a:b] - xy) ** 2).sum(axis=1)))]
        for xy, a, b in zip(at, start[:-1].tolist(), start[1:].tolist(), strict=True)
    ]
    bearing = np.arctan2(seen[:, 1], seen[:, 0])
    best, pick = 0.1, None
    for i in range(len(known)):
        for j in range(i):
            spread = abs(math.sin(bearing[i] - bearing[j]))
            if spread > best and not np.array_equal(known[i], known[j]):
                best, pick = spread, (i, j)
    if pick is None:
        return None
    first, second = (tuple(known[k].tolist()) for k in pick)
    return two_landmarks((first, second), seen[list(pick)])


def two_ranges(
    a: tuple[float, float], b: tuple[float, float], range_a_m: float, range_b_m: float
) -> list[tuple[float, float]]:
    """The positions (k, 2) with these ranges (m) to two known places a, b (2,): two, or one
    where the circles only just miss each other.

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
