"""Beams of a scanner that is not level, and points of one that sees in space, as a scan in the floor's plane."""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import kernel

THICK_M = 0.1
"""Points of a bearing so near behind the nearest one are of its surface."""


@kernel
def _project(ranges, low, step, usable, rotation, height, band, out_range, out_angle):
    off = 0
    for k in range(ranges.size):
        a = low + k * step
        c, s = np.cos(a), np.sin(a)
        dx = rotation[0, 0] * c + rotation[0, 1] * s
        dy = rotation[1, 0] * c + rotation[1, 1] * s
        dz = rotation[2, 0] * c + rotation[2, 1] * s
        flat = np.sqrt(dx * dx + dy * dy)
        out_angle[k] = np.arctan2(dy, dx)
        r = np.float64(ranges[k])
        if not r > usable[0] or r <= 0.0:
            out_range[k] = np.nan
            continue
        z = height + min(r, usable[1]) * dz
        if height > 0.0 and (z < band[0] or z > band[1]):
            out_range[k] = np.nan
            off += 1
        elif r >= usable[1]:
            out_range[k] = np.inf
        else:
            out_range[k] = r * flat
    return off


def projected(
    ranges_m: NDArray[np.floating],
    angles: tuple[float, float],
    usable_m: tuple[float, float],
    rotation: NDArray[np.float64],
    height_m: float,
    band_m: tuple[float, float],
) -> tuple[NDArray[np.float32], NDArray[np.float64], int]:
    """Ranges (n,) and bearings (n,) in the floor's plane of beams that point at angles[0] + k angles[1] in a plane that is
    turned by `rotation` (3, 3), and how many end off the walls.

    usable_m: ranges of the sensor: below is invalid (NaN), beyond is no return (inf). band_m: heights (m) between which
    things are walls; a beam that ends below or above met floor or ceiling and is NaN. height_m: of the sensor above the
    floor; 0 or less: not known, no beam is left out.
    """
    out, bearings = np.empty(ranges_m.size), np.empty(ranges_m.size)
    given = np.array(ranges_m, np.float64)
    off = _project(given, *angles, np.array(usable_m), rotation, height_m, np.array(band_m), out, bearings)
    return out.astype(np.float32), bearings, int(off)


@kernel
def _slice(points, motion, band, centre, bins, near, place, count):
    used = 0
    for again in range(2):
        for i in range(points.shape[0]):
            x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
            if not np.isfinite(x + y + z) or x * x + y * y + z * z < 1e-12:
                continue
            up = motion[2, 0] * x + motion[2, 1] * y + motion[2, 2] * z + motion[2, 3]
            if up < band[0] or up > band[1]:
                continue
            dx = motion[0, 0] * x + motion[0, 1] * y + motion[0, 2] * z + motion[0, 3] - centre[0]
            dy = motion[1, 0] * x + motion[1, 1] * y + motion[1, 2] * z + motion[1, 3] - centre[1]
            k = min(bins - 1, int((np.arctan2(dy, dx) + np.pi) / (2 * np.pi) * bins))
            r = np.sqrt(dx * dx + dy * dy)
            if again == 0:
                used += 1
                near[k] = min(near[k], r)
            elif r < near[k] + THICK_M:
                place[k, 0] += dx
                place[k, 1] += dy
                count[k] += 1
    return used


def sliced(
    points_m: NDArray[np.floating], motion: NDArray[np.float64], band_m: tuple[float, float], bins: int
) -> tuple[NDArray[np.float32], NDArray[np.float64], int]:
    """The nearest surface at each of `bins` bearings, as ranges (bins,) and bearings (bins,) about the sensor's place, NaN where
    there is none (a cloud does not say where it looked in vain); and how many points lie in the band.

    A surface is the mean of the points of a bearing that are within 10 cm of the nearest: the nearest alone would be too near by
    the noise of many rings. points_m: (n, 3) in the sensor's frame; motion: (4, 4), that frame in one whose z counts from the
    floor (m).
    """
    half = np.pi / bins
    bearing = np.linspace(-np.pi + half, np.pi - half, bins)
    place, count = np.zeros((bins, 2)), np.zeros(bins, np.int64)
    near = np.full(bins, np.inf)
    points = np.ascontiguousarray(points_m)
    used = _slice(points, motion, np.array(band_m), motion[:2, 3].copy(), bins, near, place, count)
    hit = count > 0
    near[~hit] = np.nan
    place[hit] /= count[hit, None]
    near[hit], bearing[hit] = np.sqrt((place[hit] ** 2).sum(axis=1)), _bearings(place[hit])
    return near.astype(np.float32), bearing, int(used)


@kernel
def _bearings(places):
    out = np.empty(places.shape[0])
    for k in range(out.size):
        out[k] = np.arctan2(places[k, 1], places[k, 0])
    return out
