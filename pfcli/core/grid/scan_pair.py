"""How a scanner moved between two of its scans, by the scans alone: what odometry says can be judged by it.

A rotation is found by shifting one profile of ranges over the other, then both are aligned point to line (Censi 2008).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import kernel

_WIDEST_RAD = 1.0
_TURNS = 25
_BEAMS = 90
"""About so many beams of the second scan are aligned."""


class PairMotion(NamedTuple):
    """Pose of the second scan in the frame of the first (m, m, rad, sensor frame); inliers: share of its points that lie on
    the first; held: how well both directions are held (0 in a corridor, 0.5 in a room)."""

    x_m: float
    y_m: float
    yaw_rad: float
    inliers: float
    held: float


@kernel
def _shift(first, second, limits, widest):
    """Beams by which the second profile is shifted against the first."""
    n = first.size
    best, found = np.inf, 0
    for s in range(-widest, widest + 1):
        total, count = 0.0, 0
        for i in range(max(0, -s), min(n, n - s)):
            a, b = first[i + s], second[i]
            if limits[0] < a < limits[1] and limits[0] < b < limits[1]:
                total += min(abs(a - b), 0.5)
                count += 1
        if count * 3 > n and total / count < best:
            best, found = total / count, s
    return found


@kernel
def _align(first, second, start, step, limits, pose):
    """Point-to-line alignment from `pose` on, which is moved; returns (share on surfaces, hold of the weaker direction)."""
    n = first.size
    cos, sin = np.cos(start + step * np.arange(n)), np.sin(start + step * np.arange(n))
    width = max(3, int(0.15 / abs(step)))
    stride = max(1, n // _BEAMS)
    inliers, held = 0.0, 0.0
    for turn in range(_TURNS):
        gate = max(0.1, 0.6 * 0.8**turn)
        c, s = np.cos(pose[2]), np.sin(pose[2])
        a00 = a01 = a02 = a11 = a12 = a22 = b0 = b1 = b2 = 0.0
        points, count, near = 0, 0, 0
        for i in range(0, n, stride):
            r = second[i]
            if not (limits[0] < r < limits[1]):
                continue
            px, py = r * cos[i], r * sin[i]
            rx, ry = c * px - s * py, s * px + c * py
            qx, qy = rx + pose[0], ry + pose[1]
            bearing = (np.arctan2(qy, qx) - start) / step
            turnround = 2 * np.pi / abs(step)
            bearing -= turnround * np.floor(bearing / turnround)
            middle = int(bearing + 0.5)
            if middle > n - 1 + width:
                continue
            points += 1
            best, at = gate * gate, -1
            for k in range(max(0, middle - width), min(n, middle + width + 1)):
                if limits[0] < first[k] < limits[1]:
                    dx, dy = qx - first[k] * cos[k], qy - first[k] * sin[k]
                    if dx * dx + dy * dy < best:
                        best, at = dx * dx + dy * dy, k
            if at < 0:
                continue
            fx, fy = first[at] * cos[at], first[at] * sin[at]
            close, other = 1e9, -1
            for k in (at - 1, at + 1):
                if 0 <= k < n and limits[0] < first[k] < limits[1]:
                    dx, dy = first[k] * cos[k] - fx, first[k] * sin[k] - fy
                    if dx * dx + dy * dy < close:
                        close, other = dx * dx + dy * dy, k
            if other < 0 or close > (0.1 + 3 * abs(step) * first[at]) ** 2 or close < 1e-12:
                continue
            length = np.sqrt(close)
            nx, ny = -(first[other] * sin[other] - fy) / length, (first[other] * cos[other] - fx) / length
            e = nx * (qx - fx) + ny * (qy - fy)
            near += abs(e) < 0.05 + 0.01 * r
            w = 1.0 if abs(e) < 0.03 else 0.03 / abs(e)
            j2 = -nx * ry + ny * rx
            a00 += w * nx * nx
            a01 += w * nx * ny
            a02 += w * nx * j2
            a11 += w * ny * ny
            a12 += w * ny * j2
            a22 += w * j2 * j2
            b0 -= w * nx * e
            b1 -= w * ny * e
            b2 -= w * j2 * e
            count += 1
        if count < 12:
            return 0.0, 0.0
        inliers = near / points
        d00, d01, d11 = a00 - a02 * a02 / a22, a01 - a02 * a12 / a22, a11 - a12 * a12 / a22
        half = 0.5 * (d00 + d11)
        held = (half - np.sqrt(max(0.0, half * half - (d00 * d11 - d01 * d01)))) / count
        # a corridor holds nothing along it: a little weight keeps the step finite
        ridge = 1e-3 * count
        a00 += ridge
        a11 += ridge
        a22 += 1e-3 * count
        det = a00 * (a11 * a22 - a12 * a12) - a01 * (a01 * a22 - a12 * a02) + a02 * (a01 * a12 - a11 * a02)
        if abs(det) < 1e-12:
            return 0.0, 0.0
        x = (b0 * (a11 * a22 - a12 * a12) - a01 * (b1 * a22 - a12 * b2) + a02 * (b1 * a12 - a11 * b2)) / det
        y = (a00 * (b1 * a22 - a12 * b2) - b0 * (a01 * a22 - a12 * a02) + a02 * (a01 * b2 - b1 * a02)) / det
        z = (a00 * (a11 * b2 - b1 * a12) - a01 * (a01 * b2 - b1 * a02) + b0 * (a01 * a12 - a11 * a02)) / det
        pose[0] += x
        pose[1] += y
        pose[2] += z
        if turn > 7 and x * x + y * y < 1e-8 and abs(z) < 1e-5:
            break
    return inliers, held


def pair_motion(
    first_m: NDArray[np.floating],
    second_m: NDArray[np.floating],
    angles: tuple[float, float],
    limits_m: tuple[float, float],
) -> PairMotion:
    """How the scanner moved from the first scan (n,) to the second (n,); beam k points at angles[0] + k angles[1] (rad).

    limits_m: ranges that count. Inliers are 0 where nothing could be aligned.
    """
    first, second = np.array(first_m, np.float64), np.array(second_m, np.float64)
    limits = np.array(limits_m, np.float64)
    shift = _shift(first, second, limits, int(_WIDEST_RAD / abs(angles[1])))
    best = PairMotion(x_m=0.0, y_m=0.0, yaw_rad=0.0, inliers=0.0, held=0.0)
    for yaw in {0.0, shift * angles[1]}:
        pose = np.array([0.0, 0.0, yaw])
        inliers, held = _align(first, second, float(angles[0]), float(angles[1]), limits, pose)
        if inliers > best.inliers:
            best = PairMotion(
                x_m=float(pose[0]), y_m=float(pose[1]), yaw_rad=float(pose[2]), inliers=float(inliers), held=float(held)
            )
    return best
