"""Key points and descriptors of free space: where the distance field is flat, and how it slopes around there.

After Millane 2019 (free-space features), as Akai 2023 uses them for global localisation. Maxima lie in the middle of
rooms, saddles in doors and passages, minima of a smoothed field between them. A descriptor is the histogram of the
field's gradient directions around a key point; turned against another one it also tells the rotation between them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from pfcli.core.grid.distance import distance_m
from pfcli.core.jit import kernel

BINS = 36
_MAXIMUM, _MINIMUM, _SADDLE = 0, 1, 2
_ROOM_M, _FLAT, _APART_M, _AROUND_M = 0.4, 0.4, 0.4, 1.0


class Features(NamedTuple):
    """xy_m: (k, 2) key points in the frame of the grid's origin; kind: uint8 (k,), maximum, minimum or saddle;
    room_m: (k,) distance to the nearest obstacle there; slopes: (k, BINS), gradient directions around it, norm 1."""

    xy_m: NDArray[np.float64]
    kind: NDArray[np.uint8]
    room_m: NDArray[np.float64]
    slopes: NDArray[np.float64]


def features_of(
    obstacle: NDArray[np.bool_], trusted: NDArray[np.bool_], resolution_m: float, origin_xy: tuple[float, float]
) -> Features:
    """Features of a grid. obstacle: bool (rows, cols); trusted: cells where a key point may lie.

    Where obstacles are seen only in part the field is right as long as all that is nearer than the nearest obstacle has
    been seen: `trusted` has to say so.
    """
    room = distance_m(obstacle, resolution_m)
    if not np.isfinite(room).all():
        return _empty()
    smooth = ndimage.gaussian_filter(room, 0.15 / resolution_m)
    gy, gx = np.gradient(smooth, resolution_m)
    gxy, gxx = np.gradient(gx, resolution_m)
    gyy = np.gradient(gy, resolution_m)[0]
    steep = gx * gx + gy * gy
    flat = trusted & (room > _ROOM_M) & (steep < _FLAT)
    reach = max(1, round(_APART_M / resolution_m))
    lowest = steep == ndimage.minimum_filter(np.where(flat, steep, np.inf), 2 * reach + 1)
    rows, cols = np.nonzero(flat & lowest)
    if rows.size == 0:
        return _empty()
    det = (gxx * gyy - gxy * gxy)[rows, cols]
    kind = np.where(det < 0, _SADDLE, np.where((gxx + gyy)[rows, cols] < 0, _MAXIMUM, _MINIMUM)).astype(np.uint8)
    radius = max(2, round(_AROUND_M / resolution_m))
    slopes = _slopes(gx, gy, room > 0.0, rows, cols, radius)
    norm = np.linalg.norm(slopes, axis=1)
    xy = np.column_stack([cols + 0.5, rows + 0.5]) * resolution_m + np.array(origin_xy)
    keep = norm > 0.0
    return Features(xy[keep], kind[keep], room[rows, cols][keep], slopes[keep] / norm[keep, None])


def _empty() -> Features:
    return Features(np.empty((0, 2)), np.empty(0, np.uint8), np.empty(0), np.empty((0, BINS)))


@kernel
def _slopes(gx, gy, inside, rows, cols, radius):
    """(k, BINS) sum of gradient lengths by direction in a disc around each key point."""
    out = np.zeros((rows.size, BINS))
    for k in range(rows.size):
        for i in range(max(0, rows[k] - radius), min(gx.shape[0], rows[k] + radius + 1)):
            for j in range(max(0, cols[k] - radius), min(gx.shape[1], cols[k] + radius + 1)):
                if (i - rows[k]) ** 2 + (j - cols[k]) ** 2 > radius * radius or not inside[i, j]:
                    continue
                size = np.sqrt(gx[i, j] * gx[i, j] + gy[i, j] * gy[i, j])
                turn = (np.arctan2(gy[i, j], gx[i, j]) / (2 * np.pi)) % 1.0 * BINS
                low = int(turn)
                part = turn - low
                out[k, low % BINS] += size * (1.0 - part)
                out[k, (low + 1) % BINS] += size * part
    return out


class Matches(NamedTuple):
    """pose: (m, 3) of the robot in the map, from matched key points; score: (m,) likeness of the descriptors, 0 .. 1."""

    pose: NDArray[np.float64]
    score: NDArray[np.float64]


def match(seen: Features, known: Features, most: int, room_tolerance_m: float = 0.4, turns: int = 5) -> Matches:
    """Poses of the robot from which key points seen in its frame (`seen`) lie on key points of the map (`known`).

    Pairs of one kind with like distances to obstacles; for each the `turns` rotations that bring the descriptors nearest
    to each other. The `most` with the greatest likeness are returned.
    """
    if seen.kind.size == 0 or known.kind.size == 0:
        return Matches(np.empty((0, 3)), np.empty(0))
    pairs = (seen.kind[:, None] == known.kind[None]) & (
        np.abs(seen.room_m[:, None] - known.room_m[None]) <= room_tolerance_m
    )
    i, j = np.nonzero(pairs)
    if i.size == 0:
        return Matches(np.empty((0, 3)), np.empty(0))
    turned = fft.irfft(np.conj(fft.rfft(seen.slopes, axis=1))[i] * fft.rfft(known.slopes, axis=1)[j], BINS, axis=1)
    best = np.argsort(-turned, axis=1, kind="stable")[:, :turns]
    score = np.take_along_axis(turned, best, axis=1).ravel()
    yaw = (best * (2 * np.pi / BINS)).ravel()
    a, b = np.repeat(seen.xy_m[i], turns, axis=0), np.repeat(known.xy_m[j], turns, axis=0)
    c, s = np.cos(yaw), np.sin(yaw)
    pose = np.column_stack([b[:, 0] - c * a[:, 0] + s * a[:, 1], b[:, 1] - s * a[:, 0] - c * a[:, 1], yaw])
    order = np.argsort(-score, kind="stable")[:most]
    return Matches(pose[order], score[order])


@kernel
def _clear(seen, ox, oy, ends, resolution_m):
    """Mark cells that beams from (ox, oy) to ends (b, 2) crossed, half a cell a step."""
    for b in range(ends.shape[0]):
        dx, dy = ends[b, 0] - ox, ends[b, 1] - oy
        steps = int(2.0 * max(abs(dx), abs(dy)) / resolution_m) + 1
        for k in range(steps):
            ix = int(np.floor((ox + dx * k / steps) / resolution_m))
            iy = int(np.floor((oy + dy * k / steps) / resolution_m))
            if 0 <= iy < seen.shape[0] and 0 <= ix < seen.shape[1]:
                seen[iy, ix] = True


def local_features(
    scans: list[NDArray[np.float64]], origins: NDArray[np.float64], resolution_m: float, half_m: float
) -> Features:
    """Features of what the last scans saw, in the frame they are given in, within half_m of its origin.

    scans: end points (b, 2) of each; origins: (n, 2), where each scan was taken.
    """
    size = 2 * round(half_m / resolution_m)
    obstacle, seen = np.zeros((size, size), np.bool_), np.zeros((size, size), np.bool_)
    for ends, origin in zip(scans, origins, strict=True):
        _clear(seen, origin[0] + half_m, origin[1] + half_m, ends + half_m, resolution_m)
        cell = np.floor((ends + half_m) / resolution_m).astype(np.int64)
        cell = cell[(cell >= 0).all(axis=1) & (cell < size).all(axis=1)]
        obstacle[cell[:, 1], cell[:, 0]] = True
    if not obstacle.any():
        return _empty()
    # a distance is right where no unseen cell is nearer than the nearest obstacle
    unseen = distance_m(~(seen | obstacle), resolution_m)
    trusted = seen & (unseen >= np.minimum(distance_m(obstacle, resolution_m), half_m) - 0.4)
    return features_of(obstacle, trusted, resolution_m, (-half_m, -half_m))
