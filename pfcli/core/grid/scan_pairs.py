"""Where a scanner was at one scan seen from where it was at another, by the scans alone. Censi 2008, 'An ICP variant using a
point-to-line metric', with Geman-McClure weights instead of trimming."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import kernel

_SPREAD_M = 0.02
_FAR_M, _NEAR_M, _ROUNDS = 0.6, 0.12, 40
"""End points so far from each other are partners at first, and at last; rounds at the most."""


class Surface(NamedTuple):
    """End points (n, 2) of a scan in beam order (m), and the unit normals (n, 2) of the surfaces they lie on; NaN where there is
    none."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]


class Pair(NamedTuple):
    """pose (3,): of the second scan's sensor in the first one's frame (m, m, rad); information (3, 3) of it; share of the end
    points that found a partner; spread_m: of their distances."""

    pose: NDArray[np.float64]
    information: NDArray[np.float64]
    share: float
    spread_m: float


@kernel
def _normals(points, out):
    n = points.shape[0]
    for k in range(n):
        out[k, 0] = out[k, 1] = np.nan
        reach = 0.1 + 0.11 * np.sqrt(points[k, 0] ** 2 + points[k, 1] ** 2)
        count, sx, sy, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(max(0, k - 3), min(n, k + 4)):
            dx, dy = points[j, 0] - points[k, 0], points[j, 1] - points[k, 1]
            if dx * dx + dy * dy < reach * reach:
                count += 1
                sx, sy = sx + dx, sy + dy
                sxx, sxy, syy = sxx + dx * dx, sxy + dx * dy, syy + dy * dy
        if count < 4:
            continue
        cxx, cxy, cyy = sxx - sx * sx / count, sxy - sx * sy / count, syy - sy * sy / count
        half, root = (cxx + cyy) / 2, np.sqrt(((cxx - cyy) / 2) ** 2 + cxy * cxy)
        if root <= 0.0 or half - root > 0.1 * (half + root):
            continue
        angle = 0.5 * np.arctan2(2 * cxy, cxx - cyy)
        out[k, 0], out[k, 1] = -np.sin(angle), np.cos(angle)


@kernel
def _solve(h, b, out):
    a00, a01, a02 = h[0, 0] * 1.000001 + 1e-9, h[0, 1], h[0, 2]
    a11, a12, a22 = h[1, 1] * 1.000001 + 1e-9, h[1, 2], h[2, 2] * 1.000001 + 1e-9
    c00, c01, c02 = a11 * a22 - a12 * a12, a02 * a12 - a01 * a22, a01 * a12 - a02 * a11
    det = a00 * c00 + a01 * c01 + a02 * c02
    c11, c12, c22 = a00 * a22 - a02 * a02, a01 * a02 - a00 * a12, a00 * a11 - a01 * a01
    out[0] = (c00 * b[0] + c01 * b[1] + c02 * b[2]) / det
    out[1] = (c01 * b[0] + c11 * b[1] + c12 * b[2]) / det
    out[2] = (c02 * b[0] + c12 * b[1] + c22 * b[2]) / det


@kernel
def _register(fixed, normals, moving, pose, far, near, rounds, spread, h):
    b, step = np.zeros(3), np.zeros(3)
    reach, used, squares = far, 0, 0.0
    for it in range(rounds):
        h[:, :] = 0.0
        b[:] = 0.0
        used, squares = 0, 0.0
        c, s = np.cos(pose[2]), np.sin(pose[2])
        for i in range(moving.shape[0]):
            rx, ry = c * moving[i, 0] - s * moving[i, 1], s * moving[i, 0] + c * moving[i, 1]
            x, y = pose[0] + rx, pose[1] + ry
            best, at = reach * reach, -1
            for j in range(fixed.shape[0]):
                dx, dy = x - fixed[j, 0], y - fixed[j, 1]
                d2 = dx * dx + dy * dy
                if d2 < best:
                    best, at = d2, j
            if at < 0 or not np.isfinite(normals[at, 0]):
                continue
            nx, ny = normals[at, 0], normals[at, 1]
            e = nx * (x - fixed[at, 0]) + ny * (y - fixed[at, 1])
            scale = max(spread, 0.25 * reach)
            w = 1.0 / (1.0 + (e / scale) ** 2) ** 2
            j2 = -nx * ry + ny * rx
            h[0, 0] += w * nx * nx
            h[0, 1] += w * nx * ny
            h[0, 2] += w * nx * j2
            h[1, 1] += w * ny * ny
            h[1, 2] += w * ny * j2
            h[2, 2] += w * j2 * j2
            b[0] += w * nx * e
            b[1] += w * ny * e
            b[2] += w * j2 * e
            used += 1
            squares += w * e * e
        if used < 10:
            break
        _solve(h, b, step)
        for k in range(3):
            pose[k] -= step[k]
        small = abs(step[0]) + abs(step[1]) + abs(step[2])
        if reach <= near and small < 1e-6:
            break
        if small < 0.02 or it > rounds // 2:
            reach = max(near, reach * 0.7)
    h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
    return used, squares


def surface_of(points: NDArray[np.float64]) -> Surface:
    """The surfaces of a scan's end points (n, 2), in beam order (m)."""
    normals = np.empty_like(points)
    _normals(np.ascontiguousarray(points), normals)
    return Surface(points, normals)


def register(fixed: Surface, moving: NDArray[np.float64], guess: NDArray[np.float64]) -> Pair:
    """The pose of the sensor that saw `moving` (m, 2) in the frame of `fixed`, from `guess` (3,) on."""
    pose, h = guess.astype(np.float64).copy(), np.zeros((3, 3))
    used, squares = _register(fixed.points, fixed.normals, moving, pose, _FAR_M, _NEAR_M, _ROUNDS, _SPREAD_M, h)
    spread = float(np.sqrt(squares / max(1, used - 3)))
    return Pair(pose, h / max(spread, 1e-3) ** 2, used / max(1, moving.shape[0]), spread)


def best_of(fixed: Surface, moving: NDArray[np.float64], guesses: NDArray[np.float64]) -> Pair:
    """The best registration from several guesses (g, 3): most partners, least spread."""
    found = [register(fixed, moving, guess) for guess in guesses]
    return max(found, key=lambda pair: pair.share - 5.0 * pair.spread_m)
