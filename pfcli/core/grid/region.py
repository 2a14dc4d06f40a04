"""What a partial map covers: inside, wall or outside, and where a robot can come in (Zhang 2010, definition 1)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pfcli.core.grid.distance import distance_m
from pfcli.core.jit import inline_kernel, kernel
from pfcli.core.sensor.likelihood_field import grid_frame

OUTSIDE, INSIDE, WALL = 0, 1, 2


class Region(NamedTuple):
    """place: uint8 (rows, cols) of OUTSIDE, INSIDE, WALL; to_wall: uint8 (rows, cols), whole cells from the centre of each to
    the nearest WALL's, at most 255; frame: (6,) from map coordinates to cells; resolution_m;
    free_xy: (k, 2) centres of the free cells that a robot can stand on (m, map frame);
    edge_xy: (e, 2) those near a frontier, nearest first; edge_m: (e,) their distances to it (m)."""

    place: NDArray[np.uint8]
    to_wall: NDArray[np.uint8]
    frame: NDArray[np.float64]
    resolution_m: float
    free_xy: NDArray[np.float64]
    edge_xy: NDArray[np.float64]
    edge_m: NDArray[np.float64]


def region_of(
    cells: NDArray[np.int8],
    resolution_m: float,
    origin: tuple[float, float, float],
    radius_m: float = 0.15,
    pocket_m2: float = 1.0,
    band_m: float = 2.0,
) -> Region:
    """The region of a map. cells: int8 (rows, cols), 1 occupied, 0 free, -1 unknown; everything off the grid is unknown.

    radius_m: a robot of this radius must fit through a frontier; pocket_m2: unknown patches smaller than this (behind
    furniture, inside walls) count as inside, since no robot comes out of them.
    """
    padded = np.pad(cells, 1, constant_values=-1)
    room = distance_m(padded == 1, resolution_m) > radius_m
    unknown = padded == -1
    labels, count = ndimage.label(unknown)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    sizes[labels[0, 0]] = padded.size  # what is off the grid is endless
    pocket = unknown & (sizes[labels] * resolution_m**2 < pocket_m2)
    outside = unknown & ~pocket
    place = np.where(padded == 1, WALL, np.where(outside, OUTSIDE, INSIDE)).astype(np.uint8)
    standable = (padded == 0) & room
    frontier = standable & ndimage.binary_dilation(outside & room)
    away = distance_m(frontier, resolution_m)
    rows, cols = np.nonzero(standable & (away <= band_m))
    nearest = np.argsort(away[rows, cols], kind="stable")
    rows, cols = rows[nearest], cols[nearest]
    frame = grid_frame(resolution_m, origin)
    free = np.argwhere(standable)
    return Region(
        place=np.ascontiguousarray(place[1:-1, 1:-1]),
        to_wall=np.minimum(distance_m(padded == 1, 1.0), 255.0).astype(np.uint8)[1:-1, 1:-1].copy(),
        frame=frame,
        resolution_m=resolution_m,
        free_xy=_centres(free[:, 0] - 1, free[:, 1] - 1, resolution_m, origin),
        edge_xy=_centres(rows - 1, cols - 1, resolution_m, origin),
        edge_m=away[rows, cols],
    )


def _centres(
    rows: NDArray[np.int64], cols: NDArray[np.int64], resolution_m: float, origin: tuple[float, float, float]
) -> NDArray[np.float64]:
    """Map coordinates (k, 2) of cell centres."""
    x, y, yaw = origin
    gx, gy = (cols + 0.5) * resolution_m, (rows + 0.5) * resolution_m
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([x + c * gx - s * gy, y + s * gx + c * gy], axis=1)


@inline_kernel
def place_at(place, frame, x, y):
    """What a grid holds at (x, y), map frame (m): OUTSIDE, INSIDE or WALL; 0, which is OUTSIDE, off the grid."""
    ix = int(np.floor(frame[0] * x + frame[1] * y + frame[2]))
    iy = int(np.floor(frame[3] * x + frame[4] * y + frame[5]))
    if ix < 0 or iy < 0 or ix >= place.shape[1] or iy >= place.shape[0]:
        return 0
    return np.int64(place[iy, ix])


@kernel
def crosses_wall(place, frame, x0, y0, x1, y1):
    """Whether the straight move from (x0, y0) to (x1, y1) passes an occupied cell (half a cell a step; not its start)."""
    gx0, gy0 = frame[0] * x0 + frame[1] * y0 + frame[2], frame[3] * x0 + frame[4] * y0 + frame[5]
    gx1, gy1 = frame[0] * x1 + frame[1] * y1 + frame[2], frame[3] * x1 + frame[4] * y1 + frame[5]
    steps = int(2.0 * max(abs(gx1 - gx0), abs(gy1 - gy0))) + 1
    for k in range(1, steps + 1):
        ix = int(np.floor(gx0 + (gx1 - gx0) * k / steps))
        iy = int(np.floor(gy0 + (gy1 - gy0) * k / steps))
        if 0 <= ix < place.shape[1] and 0 <= iy < place.shape[0] and place[iy, ix] == 2:
            return True
    return False


@inline_kernel
def clearance(to_wall, frame, x, y):
    """How far (cells) a move from (x, y) certainly meets no wall; 0 where it may."""
    # start and wall are at most 0.71 cells from the centres of their cells
    return max(0.0, place_at(to_wall, frame, x, y) - 1.5)


@kernel
def places_at(place, frame, xy):
    """What `place_at` says of each point (n, 2)."""
    out = np.empty(xy.shape[0], np.uint8)
    for i in range(xy.shape[0]):
        out[i] = place_at(place, frame, xy[i, 0], xy[i, 1])
    return out


@kernel
def only(shape, frame, xy):
    """uint8 of this shape, INSIDE in the cells that hold the points (n, 2) of the grid, OUTSIDE elsewhere."""
    out = np.zeros(shape, np.uint8)
    for i in range(xy.shape[0]):
        ix = int(np.floor(frame[0] * xy[i, 0] + frame[1] * xy[i, 1] + frame[2]))
        iy = int(np.floor(frame[3] * xy[i, 0] + frame[4] * xy[i, 1] + frame[5]))
        out[iy, ix] = 1
    return out


def places(region: Region, xy: NDArray[np.float64]) -> NDArray[np.uint8]:
    """OUTSIDE, INSIDE or WALL of each point (n, 2)."""
    found: NDArray[np.uint8] = places_at(region.place, region.frame, np.ascontiguousarray(xy, np.float64))
    return found
