"""A correlative search for a pose in a particle's map, at a grain that finds the basin of a match (Olson 2009)."""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.tiles import BITS, REACH, SIDE, Tiles, squared_distance
from pfcli.core.jit import kernel

_ASK = 8
"""After so many end points a coarse score is asked whether it can still become the best; every so many-th comes first."""


@kernel
def _coarse_score(tiles, i, x, y, rotated, likelihood, least):
    """Mean likelihood of end points by their distance to the nearest occupied cell; unknown cells count a third.

    Given up with -1 as soon as the rest cannot bring it above `least`.
    """
    per_cell = 1.0 / tiles.resolution_m
    ox, oy = x * per_cell - tiles.corner[0] * SIDE, y * per_cell - tiles.corner[1] * SIDE
    n = rotated.shape[0]
    total, needed = 0.0, least * n
    for b in range(n):
        if b % _ASK == 0 and total + (n - b) <= needed:
            return -1.0
        ix, iy = int(np.floor(rotated[b, 0] + ox)), int(np.floor(rotated[b, 1] + oy))
        tx, ty = ix >> BITS, iy >> BITS
        if tx < 0 or ty < 0 or tx >= tiles.index.shape[2] or ty >= tiles.index.shape[1]:
            total += 0.3
            continue
        tile = tiles.index[i, ty, tx]
        if tile < 0:
            total += 0.3
            continue
        at, cell = np.uintp(tile), np.uintp(((iy & (SIDE - 1)) << BITS) | (ix & (SIDE - 1)))
        square = squared_distance(tiles, at, cell)
        if square <= REACH * REACH:
            total += likelihood[square]
        elif tiles.counts[at, cell] == 0:
            total += 0.3
    return total / n


class Window(NamedTuple):
    """A correlative search: half widths and steps (m, rad), the spread of an end point at that grain (m), how many end points are
    asked, and how much better their mean likelihood must be than at the start."""

    half_xy_m: float
    half_yaw_rad: float
    step_xy_m: float
    step_yaw_rad: float
    sigma_m: float
    beams: int
    gain: float


@kernel
def _turned(points, yaw, per_cell, out):
    """End points seen from a pose of that heading, in cells. Far from each other in the scan come first, so that a few tell."""
    cos, sin = np.cos(yaw) * per_cell, np.sin(yaw) * per_cell
    k = 0
    for first in range(_ASK):
        for b in range(first, points.shape[0], _ASK):
            out[k, 0] = cos * points[b, 0] - sin * points[b, 1]
            out[k, 1] = sin * points[b, 0] + cos * points[b, 1]
            k += 1


@kernel
def _search(tiles, i, start, points, window, table, correction):
    """Writes the correction (3,) to the best penalised score, zero where none is better than the start by the window's gain."""
    half = int(np.ceil(window.half_yaw_rad / window.step_yaw_rad))
    n_xy = int(np.ceil(window.half_xy_m / window.step_xy_m))
    per_cell = 1.0 / tiles.resolution_m
    cos0, sin0 = np.cos(start[2]), np.sin(start[2])
    rotated = np.empty(points.shape)
    _turned(points, start[2], per_cell, rotated)
    before = _coarse_score(tiles, i, start[0], start[1], rotated, table, 0.0)
    best = before + window.gain
    correction[:] = 0.0
    for a in range(-half, half + 1):
        turn = a * window.step_yaw_rad
        _turned(points, start[2] + turn, per_cell, rotated)
        for jx in range(-n_xy, n_xy + 1):
            for jy in range(-n_xy, n_xy + 1):
                dx, dy = jx * window.step_xy_m, jy * window.step_xy_m
                x, y = start[0] + cos0 * dx - sin0 * dy, start[1] + sin0 * dx + cos0 * dy
                penalty = 0.03 * ((dx * dx + dy * dy) / (2.0 * window.half_xy_m**2) + (turn / window.half_yaw_rad) ** 2)
                score = _coarse_score(tiles, i, x, y, rotated, table, best + penalty) - penalty
                if score > best:
                    best = score
                    correction[0], correction[1], correction[2] = dx, dy, turn


@functools.cache
def _likelihoods(cells: float) -> NDArray[np.float64]:
    """exp(-d^2 / 2) by squared distance in cells, each `cells` standard deviations wide."""
    return np.array([math.exp(-0.5 * k * cells * cells) for k in range(REACH * REACH + 1)])


def coarse(
    tiles: Tiles, i: int, start: NDArray[np.float64], points: NDArray[np.float64], window: Window
) -> NDArray[np.float64]:
    """Correlative search around `start` in the map of particle i.

    points: (b, 2) end points in the base frame (m). Returns the correction (3,) in the frame of `start` (m, rad) to the pose of
    the best score; zero where none is better than that of `start` by the window's gain.
    """
    correction, asked = np.empty(3), points[:: max(1, points.shape[0] // window.beams)].copy()
    _search(tiles, i, start, asked, window, _likelihoods(tiles.resolution_m / window.sigma_m), correction)
    return correction
