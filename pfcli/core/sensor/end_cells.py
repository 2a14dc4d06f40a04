"""In which cells of a grid the end points of a scan lie, for a block of poses, beam by beam.

One beam of many poses ends in few cells, which stay in the nearest cache, and all but the look-up is done for several poses
at once.
"""

import numpy as np

from pfcli.core.jit import inline_kernel


@inline_kernel
def place(poses, frame, yaw, placed):
    """Into placed, float32 (4, n or more): x and y of poses (n, 3) in cells, and cosine and sine of their turns in cells per
    metre. frame: (6,), of the grid (`grid_frame`), which is turned by yaw."""
    scale = np.sqrt(frame[0] * frame[0] + frame[3] * frame[3])
    for i in range(poses.shape[0]):
        placed[0, i] = frame[0] * poses[i, 0] + frame[1] * poses[i, 1] + frame[2]
        placed[1, i] = frame[3] * poses[i, 0] + frame[4] * poses[i, 1] + frame[5]
        placed[2, i], placed[3, i] = np.cos(poses[i, 2] - yaw) * scale, np.sin(poses[i, 2] - yaw) * scale


@inline_kernel
def cells_of(placed, px, py, shape, shift, at, n):
    """Flat index (n,) of the cell where a beam ends, which is at (px, py) in the base frame; off the map that of the border.

    placed: (4, n or more), by `place`; shape: rows and columns, with the border; shift: added, for one table of several.
    """
    x, y, c, s = placed[0], placed[1], placed[2], placed[3]
    bottom, right, cols = np.float32(shape[0] - 1), np.float32(shape[1] - 1), np.int32(shape[1])
    zero = np.float32(0.0)
    for i in range(n):
        gx, gy = x[i] + c[i] * px - s[i] * py, y[i] + s[i] * px + c[i] * py
        # written so that what is no number counts as off the map
        ix, iy = np.int32(min(gx if gx > zero else zero, right)), np.int32(min(gy if gy > zero else zero, bottom))
        at[i] = iy * cols + ix + shift


@inline_kernel
def look_up(table, at, found, n):
    """found[i] = table[at[i]] for i < n; found (>= n,), at int (>= n,), table flat."""
    for i in range(n):
        found[i] = table[np.uint32(at[i])]
