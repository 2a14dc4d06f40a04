"""What the last metres of a drive explain of a scan, without any map: a rolling grid of end points by odometry.

A robot in an unknown corridor predicts its next scan well. Only against that prediction does a map have to prove
itself: else every corridor looks like the mapped one. (The idea: Stewart et al. 2003, 'The revisiting problem'.)
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import kernel

_SIDE = 1024
_CELL_M = 0.1
_REACH = 2
_CONFIRMED_M, _CONFIRMED_PER_M = 1.0, 4.0
_CONFIRMED_FEWEST, _CONFIRMED_MOST = 3.0, 12.0
"""A surface has stood for a metre of way and was hit so often per metre since, within these bounds."""


class LocalHistory(NamedTuple):
    """A torus of cells: first_m, way_m (n, n), way at which a cell was first and last hit within the window; hits uint8
    (n, n), how often; thing_m (n, n), way at which it was last marked as a thing that the map lacks."""

    first_m: NDArray[np.float32]
    way_m: NDArray[np.float32]
    hits: NDArray[np.uint8]
    thing_m: NDArray[np.float32]


def empty() -> LocalHistory:
    """Nothing seen yet."""
    never = np.full((_SIDE, _SIDE), -np.inf, np.float32)
    return LocalHistory(never.copy(), never.copy(), np.zeros((_SIDE, _SIDE), np.uint8), never)


@kernel
def explained_m(history, pose, points, way_m, window_m):
    """Distances (2, b) in m of each end point to the nearest place that was hit before; inf where none is near.

    pose: (3,) odometry; points: float32 (2, b), base frame. Row 0 counts every hit of the last `window_m` of way, row 1
    only places first seen a metre ago and hit again and again since: people who walk by do not stay, and where another
    walked before is no surface either.
    """
    out = np.empty((2, points.shape[1]))
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for b in range(points.shape[1]):
        gx = int(np.floor((pose[0] + c * points[0, b] - s * points[1, b]) / _CELL_M))
        gy = int(np.floor((pose[1] + s * points[0, b] + c * points[1, b]) / _CELL_M))
        once, often = np.inf, np.inf
        for dy in range(-_REACH, _REACH + 1):
            for dx in range(-_REACH, _REACH + 1):
                iy, ix = (gy + dy) & (_SIDE - 1), (gx + dx) & (_SIDE - 1)
                if way_m - history.way_m[iy, ix] <= window_m:
                    square = float(dx * dx + dy * dy)
                    once = min(once, square)
                    stood_m = way_m - history.first_m[iy, ix]
                    enough = max(_CONFIRMED_FEWEST, min(_CONFIRMED_PER_M * stood_m, _CONFIRMED_MOST))
                    if stood_m >= _CONFIRMED_M and history.hits[iy, ix] >= enough:
                        often = min(often, square)
        out[0, b], out[1, b] = np.sqrt(once) * _CELL_M, np.sqrt(often) * _CELL_M
    return out


@kernel
def remember(history, pose, points, way_m, window_m):
    """Add a scan. points: float32 (2, b), base frame."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for b in range(points.shape[1]):
        ix = int(np.floor((pose[0] + c * points[0, b] - s * points[1, b]) / _CELL_M)) & (_SIDE - 1)
        iy = int(np.floor((pose[1] + s * points[0, b] + c * points[1, b]) / _CELL_M)) & (_SIDE - 1)
        if way_m - history.way_m[iy, ix] > window_m:
            history.hits[iy, ix] = 0
            history.first_m[iy, ix] = way_m
        if history.hits[iy, ix] < 255:
            history.hits[iy, ix] += 1
        history.way_m[iy, ix] = way_m


@kernel
def mark(history, pose, points, way_m):
    """Mark the cells of points as things that the map lacks. pose: (3,) odometry; points: float32 (2, b), base frame (m)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for b in range(points.shape[1]):
        ix = int(np.floor((pose[0] + c * points[0, b] - s * points[1, b]) / _CELL_M)) & (_SIDE - 1)
        iy = int(np.floor((pose[1] + s * points[0, b] + c * points[1, b]) / _CELL_M)) & (_SIDE - 1)
        history.thing_m[iy, ix] = way_m


@kernel
def marked(history, pose, points, way_m, window_m):
    """(b,) which points end within two cells of a thing that was marked in the last `window_m` of way; see `mark`."""
    out = np.zeros(points.shape[1], np.bool_)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for b in range(points.shape[1]):
        gx = int(np.floor((pose[0] + c * points[0, b] - s * points[1, b]) / _CELL_M))
        gy = int(np.floor((pose[1] + s * points[0, b] + c * points[1, b]) / _CELL_M))
        for dy in range(-_REACH, _REACH + 1):
            for dx in range(-_REACH, _REACH + 1):
                iy, ix = (gy + dy) & (_SIDE - 1), (gx + dx) & (_SIDE - 1)
                if way_m - history.thing_m[iy, ix] <= window_m:
                    out[b] = True
    return out
