"""Normals of surfaces: from neighbouring end points of a scan, or from neighbouring occupied cells of a map."""

import numpy as np

from pfcli.core.grid.tiles import BITS, FREE, MEAN_X, MEAN_Y, SIDE, STEP
from pfcli.core.jit import inline_kernel, kernel

_REACH_M, _GAP = 0.15, 0.1
_CELLS = 3
"""So many cells each way around a surface point tell its direction."""
_FLAT = 0.1
"""Variance across over variance along, up to which points are a line."""


@inline_kernel
def _add(sums, dx, dy):
    """Count, sums and sums of products of points, with one more."""
    count, sx, sy, sxx, sxy, syy = sums
    return count + 1, sx + dx, sy + dy, sxx + dx * dx, sxy + dx * dy, syy + dy * dy


@inline_kernel
def _fit(sums):
    """Unit normal of the line through points, given their sums, and whether they are a line."""
    count, sx, sy, sxx, sxy, syy = sums
    mx, my = sx / count, sy / count
    cxx, cxy, cyy = sxx / count - mx * mx, sxy / count - mx * my, syy / count - my * my
    half, root = (cxx + cyy) / 2, np.hypot((cxx - cyy) / 2, cxy)
    if half + root <= 0.0 or (half - root) > _FLAT * (half + root):
        return 1.0, 0.0, False
    angle = 0.5 * np.arctan2(2 * cxy, cxx - cyy)
    return -np.sin(angle), np.cos(angle), True


@kernel
def scan_normals(points, blur):
    """Unit normals of the surface at each end point, from a line fitted to its neighbours in the scan.

    points: (b, 2) in beam order (m). Neighbours count while they are within `_REACH_M` of the point (or are its
    direct neighbours) and no step between two of them exceeds `_GAP` times the point's range (a depth edge).
    Returns (b, 4): normal, 1 (or 0 where no line is certain), and the weight 1 / (1 + (blur r sin i)^2): what a beam of
    some width says of a surface at incidence i falls off with range r (blur: width in rad over sigma in m).
    """
    n = points.shape[0]
    out = np.zeros((n, 4))
    for b in range(n):
        x0, y0 = points[b]
        reach2 = x0 * x0 + y0 * y0
        edge2, wide2 = max(0.01, _GAP * _GAP * reach2), _REACH_M * _REACH_M
        out[b, 3] = 1.0
        sums = (1, 0.0, 0.0, 0.0, 0.0, 0.0)
        for side in (-1, 1):
            k, px, py = b + side, x0, y0
            while 0 <= k < n and abs(k - b) <= 12:
                dx, dy, gx, gy = points[k, 0] - x0, points[k, 1] - y0, points[k, 0] - px, points[k, 1] - py
                if gx * gx + gy * gy > edge2 or (abs(k - b) > 1 and dx * dx + dy * dy > wide2):
                    break
                sums = _add(sums, dx, dy)
                px, py = points[k]
                k += side
        if sums[0] < 3:
            continue
        nx, ny, line = _fit(sums)
        if not line:
            continue
        out[b, 0], out[b, 1], out[b, 2] = nx, ny, 1.0
        across = out[b, 0] * x0 + out[b, 1] * y0
        out[b, 3] = 1.0 / (1.0 + blur * blur * max(0.0, reach2 - across * across))
    return out


@kernel
def map_normal(tiles, i, mx, my):
    """Unit normal of the surface of particle i's map around the surface point (mx, my), in cells from the table's corner.

    Returns (x, y, 2); (1, 0, 1) where the occupied cells around are no line, (1, 0, 0) where there are fewer than three.
    """
    cx, cy = int(np.floor(mx)), int(np.floor(my))
    sums = (0, 0.0, 0.0, 0.0, 0.0, 0.0)
    _, rows, columns = tiles.index.shape
    for y in range(max(0, cy - _CELLS), min(rows * SIDE, cy + _CELLS + 1)):
        for x in range(max(0, cx - _CELLS), min(columns * SIDE, cx + _CELLS + 1)):
            tile = tiles.index[i, y >> BITS, x >> BITS]
            if tile < 0:
                continue
            cell = ((y & (SIDE - 1)) << BITS) | (x & (SIDE - 1))
            mean_x = tiles.surface[tile, cell, MEAN_X]
            if mean_x == FREE:
                continue
            dx, dy = x + mean_x * STEP - mx, y + tiles.surface[tile, cell, MEAN_Y] * STEP - my
            sums = _add(sums, dx, dy)
    if sums[0] < 3:
        return 1.0, 0.0, 0
    nx, ny, line = _fit(sums)
    return nx, ny, 2 if line else 1
