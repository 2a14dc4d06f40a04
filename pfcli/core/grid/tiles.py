"""Grid maps of many particles in copy-on-write tiles.

A tile holds 32 x 32 cells; particles that agree about a tile share it, so memory grows with the mapped area and
with how much the particles differ, not with particles x area. A cell keeps how often a beam ended in it (hits)
or touched it at all (visits), the mean of the end points (sub-cell accurate surface) and the offset to the
nearest occupied cell (a truncated distance transform that is updated in place).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import inline_kernel, kernel
from pfcli.core.threads import spread
from pfcli.errors import FilterDegenerate

BITS = 5
SIDE = 1 << BITS
CELLS = SIDE * SIDE
NONE = 255
FREE = 255
OFF_X, OFF_Y, MEAN_X, MEAN_Y = range(4)
"""Columns of `Tiles.surface`."""
REACH = 8
"""Cells up to which the nearest occupied cell is known (0.4 m at 0.05 m)."""
MOST = 160_000
"""Tiles of all particles together: 2.2 GiB."""
_TILE_BYTES = CELLS * (2 + 8 + 4)
_SATURATED = 254
STEP = 1.0 / 254.0
_ONE = 4294967296.0


class Tiles(NamedTuple):
    """The pool of tiles and each particle's table of them.

    index: int32 (n, rows, cols), tile number or -1; corner: int64 (2,), tile coordinates of index[:, 0, 0];
    refs: int32 (capacity,); free: int32 (capacity,), a stack; top: int64 (1,), its height;
    counts: uint16 (capacity, 1024), visits in the low byte and hits in the high one;
    mean: float32 (capacity, 1024, 2), in cells from the cell's corner;
    surface: uint8 (capacity, 1024, 4), offset in cells to the nearest occupied cell plus REACH (NONE, any where there is none
    in reach), and the mean in 1/254 cell (FREE, any where the cell is not occupied). Matching reads this, 4 KiB a tile: one
    cache line where the end point's own cell is occupied; and `counts` where nothing is in reach.
    """

    index: NDArray[np.int32]  # type: ignore[assignment]  # shadows tuple.index, which nobody calls
    corner: NDArray[np.int64]
    refs: NDArray[np.int32]
    free: NDArray[np.int32]
    top: NDArray[np.int64]
    counts: NDArray[np.uint16]
    mean: NDArray[np.float32]
    surface: NDArray[np.uint8]
    resolution_m: float


def empty(n: int, resolution_m: float, capacity: int = 4096) -> Tiles:
    """Tables (n, rows, columns) of tiles for `n` particles, all of the world unknown, centred on the origin of the map frame."""
    return Tiles(
        index=np.full((n, 16, 16), -1, np.int32),
        corner=np.array([-8, -8], np.int64),
        refs=np.zeros(capacity, np.int32),
        free=np.arange(capacity, dtype=np.int32)[::-1].copy(),
        top=np.array([capacity], np.int64),
        counts=np.zeros((capacity, CELLS), np.uint16),
        mean=np.empty((capacity, CELLS, 2), np.float32),
        surface=np.empty((capacity, CELLS, 4), np.uint8),
        resolution_m=resolution_m,
    )


def cover(tiles: Tiles, low_xy_m: NDArray[np.float64], high_xy_m: NDArray[np.float64]) -> Tiles:
    """Grow the tables so that they hold the box `low_xy_m` .. `high_xy_m` (m, map frame) with a tile to spare."""
    side_m = SIDE * tiles.resolution_m
    low = np.floor(low_xy_m / side_m).astype(np.int64) - 1
    high = np.floor(high_xy_m / side_m).astype(np.int64) + 2
    n, rows, cols = tiles.index.shape
    old_high = tiles.corner + np.array([cols, rows])
    if (low >= tiles.corner).all() and (high <= old_high).all():
        return tiles
    grown = np.maximum(16, (old_high - tiles.corner) // 4)  # so that the tables are copied rarely
    corner = np.where(low < tiles.corner, np.minimum(low, tiles.corner - grown), tiles.corner)
    top = np.where(high > old_high, np.maximum(high, old_high + grown), old_high)
    index = np.full((n, top[1] - corner[1], top[0] - corner[0]), -1, np.int32)
    dx, dy = tiles.corner - corner
    index[:, dy : dy + rows, dx : dx + cols] = tiles.index
    return tiles._replace(index=index, corner=corner)


def _with_room(tiles: Tiles, needed: int) -> Tiles:
    """Grow the pool until `needed` tiles are free; what a tile holds is set when it is taken. Raises FilterDegenerate beyond
    `MOST` tiles: no drive needs them, but ranges in another unit do."""
    free = int(tiles.top[0])
    if free >= needed:
        return tiles
    old = tiles.refs.size
    if old + needed - free > MOST:
        raise FilterDegenerate(
            f"the maps of all particles need more than {MOST} tiles ({MOST * _TILE_BYTES >> 20} MiB); a shorter"
            " --max-range-m, fewer --particles or a coarser --resolution-m need less"
        )
    new = min(max(old + needed - free, 2 * old), MOST)
    stack = np.concatenate([np.arange(old, new, dtype=np.int32)[::-1], tiles.free[:free]])
    return tiles._replace(
        refs=_grown(tiles.refs, new),
        free=np.concatenate([stack, np.zeros(new - stack.size, np.int32)]),
        top=np.array([stack.size], np.int64),
        counts=_grown(tiles.counts, new),
        mean=_grown(tiles.mean, new),
        surface=_grown(tiles.surface, new),
    )


def _grown(array: NDArray[Any], capacity: int) -> NDArray[Any]:
    out = np.empty((capacity, *array.shape[1:]), array.dtype)
    out[: array.shape[0]] = array
    if array.ndim == 1:
        out[array.shape[0] :] = 0
    return out


def draw(tiles: Tiles, poses: NDArray[np.float64], chosen: NDArray[np.bool_], beams: "Beams") -> Tiles:
    """Draw a scan into the maps of the chosen particles (n,) at their poses (n, 3), base frame in the map frame (m, rad)."""
    reach = np.hypot(beams.ends[:, 0], beams.ends[:, 1]).max() + REACH * tiles.resolution_m
    reach = max(reach, float(np.hypot(*beams.origin))) + tiles.resolution_m
    tiles = cover(tiles, poses[:, :2].min(axis=0) - reach, poses[:, :2].max(axis=0) + reach)
    tiles = own(tiles, touch(tiles, poses, beams))
    insert(tiles, poses, chosen, beams)
    return tiles


def resample(tiles: Tiles, ancestors: NDArray[np.int64]) -> Tiles:
    """Give particle i the tiles of particle ancestors[i]: tables are copied, tiles are shared."""
    index = tiles.index[ancestors]
    _recount(tiles.index.ravel(), index.ravel(), tiles.refs, tiles.free, tiles.top)
    return tiles._replace(index=index)


@kernel
def _recount(old, new, refs, free, top):
    """Move the reference counts from the old tables (flat) to the new; tiles nobody holds go back to the stack."""
    for tile in new:
        if tile >= 0:
            refs[tile] += 1
    for tile in old:
        if tile >= 0:
            refs[tile] -= 1
            if refs[tile] == 0:
                free[top[0]] = tile
                top[0] += 1


def own(tiles: Tiles, touched: NDArray[np.uint8]) -> Tiles:
    """Make every touched tile the particle's own: fresh where unknown, a copy where shared.

    touched: uint8 (n, rows, cols), as `touch` marks it.
    """
    foreign = _foreign(tiles.index.ravel(), tiles.refs, touched.ravel())
    if foreign.size:
        tiles = _with_room(tiles, foreign.size)
        _take_ownership(tiles, tiles.index.ravel(), foreign)
    return tiles


@kernel
def _foreign(flat, refs, marks):
    """Flat table positions that are touched but not the particle's own."""
    out = np.empty(flat.size, np.int64)
    count = 0
    for k in range(flat.size):
        if marks[k] and (flat[k] < 0 or refs[flat[k]] > 1):
            out[count] = k
            count += 1
    return out[:count]


@kernel
def _clear(tiles, tile):
    for k in range(CELLS):
        tiles.counts[tile, k] = 0
        tiles.surface[tile, k, OFF_X] = NONE
        tiles.surface[tile, k, MEAN_X] = FREE


@kernel
def _copy(tiles, old, new):
    for k in range(CELLS):
        tiles.counts[new, k] = tiles.counts[old, k]
        for c in range(2):
            tiles.mean[new, k, c] = tiles.mean[old, k, c]
        for c in range(4):
            tiles.surface[new, k, c] = tiles.surface[old, k, c]


@kernel
def _take_ownership(tiles, flat, foreign):
    """Give each foreign position of the flat table a tile of its own."""
    for k in foreign:
        old = flat[k]
        if old >= 0 and tiles.refs[old] == 1:
            continue
        tiles.top[0] -= 1
        tile = tiles.free[tiles.top[0]]
        tiles.refs[tile] = 1
        flat[k] = tile
        if old < 0:
            _clear(tiles, tile)
        else:
            tiles.refs[old] -= 1
            _copy(tiles, old, tile)


@inline_kernel
def nearest_surface(tiles, i, gx, gy):
    """Surface point nearest to (gx, gy), in cells from the table's corner.

    Returns (state, x, y): state 2 with the mean end point of the nearest occupied cell, 1 where the cell was seen
    but nothing is near, 0 where the map is unknown.
    """
    ix, iy = int(np.floor(gx)), int(np.floor(gy))
    tx, ty = ix >> BITS, iy >> BITS
    if tx < 0 or ty < 0 or tx >= tiles.index.shape[2] or ty >= tiles.index.shape[1]:
        return 0, 0.0, 0.0
    tile = tiles.index[i, ty, tx]
    if tile < 0:
        return 0, 0.0, 0.0
    at, cell = np.uintp(tile), np.uintp(((iy & (SIDE - 1)) << BITS) | (ix & (SIDE - 1)))
    off_x = tiles.surface[at, cell, OFF_X]
    if off_x == NONE:
        return (1 if tiles.counts[at, cell] > 0 else 0), 0.0, 0.0
    jx, jy = ix + np.int64(off_x) - REACH, iy + np.int64(tiles.surface[at, cell, OFF_Y]) - REACH
    tile = np.uintp(tiles.index[i, jy >> BITS, jx >> BITS])
    there = np.uintp(((jy & (SIDE - 1)) << BITS) | (jx & (SIDE - 1)))
    sx = tiles.surface[tile, there, MEAN_X]
    if sx == FREE:
        return 1, 0.0, 0.0
    return 2, jx + sx * STEP, jy + tiles.surface[tile, there, MEAN_Y] * STEP


@inline_kernel
def squared_distance(tiles, tile, cell):
    """Squared distance in cells from a cell to the nearest occupied one; above REACH^2 where none is in reach."""
    off_x = np.int64(tiles.surface[tile, cell, OFF_X]) - REACH
    if off_x == NONE - REACH:
        return REACH * REACH + 1
    off_y = np.int64(tiles.surface[tile, cell, OFF_Y]) - REACH
    return off_x * off_x + off_y * off_y


class Beams(NamedTuple):
    """A scan to insert: origin (2,), sensor in the base frame (m); ends (b, 2), end points in the base frame (m);
    hit (b,), 1 where the end is a surface; skip (b,), share of the beam near the sensor that its neighbours cover."""

    origin: NDArray[np.float64]
    ends: NDArray[np.float64]
    hit: NDArray[np.uint8]
    skip: NDArray[np.float64]


@kernel
def _touch_one(corner, resolution_m, pose, beams, touched):
    per_tile = 1.0 / (resolution_m * SIDE)
    margin = (REACH + 1) / SIDE
    cos, sin = np.cos(pose[2]) * per_tile, np.sin(pose[2]) * per_tile
    bx, by = pose[0] * per_tile - corner[0], pose[1] * per_tile - corner[1]
    sx = bx + cos * beams.origin[0] - sin * beams.origin[1]
    sy = by + sin * beams.origin[0] + cos * beams.origin[1]
    for b in range(beams.hit.size):
        ex = bx + cos * beams.ends[b, 0] - sin * beams.ends[b, 1]
        ey = by + sin * beams.ends[b, 0] + cos * beams.ends[b, 1]
        _walk(sx, sy, ex - sx, ey - sy, touched)
        if beams.hit[b]:
            for ty in (int(ey - margin), int(ey + margin)):
                for tx in (int(ex - margin), int(ex + margin)):
                    touched[ty, tx] = 1


@kernel
def _touch_all(corner, resolution_m, poses, beams, touched):
    for i in range(poses.shape[0]):
        _touch_one(corner, resolution_m, poses[i], beams, touched[i])


def touch(tiles: Tiles, poses: NDArray[np.float64], beams: Beams) -> NDArray[np.uint8]:
    """Mark the tiles that inserting a scan at each pose may write.

    poses: (n, 3) of the base in the map frame (m, rad). Returns uint8 (n, rows, cols).
    """
    touched = np.zeros(tiles.index.shape, np.uint8)
    _touch_all(tiles.corner, tiles.resolution_m, poses, beams, touched)
    return touched


@inline_kernel
def _walk(x, y, dx, dy, touched):
    """Mark the tiles within a cell and a half of the segment from (x, y) along (dx, dy), in tiles."""
    margin = 1.5 / SIDE
    steep = abs(dy) > abs(dx)
    if steep:
        x, y, dx, dy = y, x, dy, dx
    slope = dy / dx if dx != 0.0 else 0.0
    low, high = min(x, x + dx), max(x, x + dx)
    for c in range(int(low - margin), int(high + margin) + 1):
        at, to = y + (max(low, c) - x) * slope, y + (min(high, c + 1.0) - x) * slope
        for r in range(int(min(at, to) - margin), int(max(at, to) + margin) + 1):
            if steep:
                touched[c, r] = 1
            else:
                touched[r, c] = 1


@kernel
def _insert_one(tiles, i, pose, beams):
    per_cell = 1.0 / tiles.resolution_m
    cos, sin = np.cos(pose[2]) * per_cell, np.sin(pose[2]) * per_cell
    bx, by = pose[0] * per_cell - tiles.corner[0] * SIDE, pose[1] * per_cell - tiles.corner[1] * SIDE
    sx = bx + cos * beams.origin[0] - sin * beams.origin[1]
    sy = by + sin * beams.origin[0] + cos * beams.origin[1]
    for b in range(beams.hit.size):
        dx = bx + cos * beams.ends[b, 0] - sin * beams.ends[b, 1] - sx
        dy = by + sin * beams.ends[b, 0] + cos * beams.ends[b, 1] - sy
        t = beams.skip[b]
        _pass_through(tiles, i, sx + t * dx, sy + t * dy, (1 - t) * dx, (1 - t) * dy)
    for b in range(beams.hit.size):
        if beams.hit[b]:
            ex = bx + cos * beams.ends[b, 0] - sin * beams.ends[b, 1]
            ey = by + sin * beams.ends[b, 0] + cos * beams.ends[b, 1]
            _hit(tiles, i, ex, ey)


@kernel
def _insert_rows(low, high, tiles, poses, chosen, beams):
    for i in range(low, high):
        if chosen[i]:
            _insert_one(tiles, i, poses[i], beams)


def insert(tiles: Tiles, poses: NDArray[np.float64], chosen: NDArray[np.bool_], beams: Beams) -> None:
    """Draw a scan into the maps of the chosen particles (n,), whose touched tiles they must own."""
    spread(_insert_rows, poses.shape[0], tiles, poses, chosen, beams)


@kernel
def _pass_through(tiles, i, x, y, dx, dy):
    """Count a visit in one cell per step of the beam's longer axis, but its last (Bresenham's choice of cells).

    The shorter axis runs in fixed point (2^32 a cell), tile by tile, so that the inner loop neither converts nor checks.
    """
    steep = abs(dy) > abs(dx)
    if steep:
        x, y, dx, dy = y, x, dy, dx
    u = int(x)
    left = abs(int(x + dx) - u)
    if left == 0:
        return
    step = 1 if dx > 0 else -1
    slope = dy / abs(dx)
    rise = int(slope * _ONE)
    v = int((y + ((u + 0.5 - x) * step) * slope) * _ONE)
    shift_u, shift_v = (BITS, 0) if steep else (0, BITS)
    while left > 0:
        tu, tv = u >> BITS, v >> (32 + BITS)
        tile = np.uintp(tiles.index[i, tu, tv] if steep else tiles.index[i, tv, tu])
        iu = u & (SIDE - 1)
        run = min(left, SIDE - iu if step > 0 else iu + 1)
        if rise > 0:
            run = min(run, (((tv + 1) << (32 + BITS)) - v + rise - 1) // rise)
        elif rise < 0:
            run = min(run, (v - (tv << (32 + BITS))) // -rise + 1)
        u += step * run
        left -= run
        for _ in range(run):
            cell = np.uintp((iu << shift_u) | (((v >> 32) & (SIDE - 1)) << shift_v))
            iu += step
            v += rise
            before = tiles.counts[tile, cell]
            if before < _SATURATED:  # never hit: nearly all cells
                tiles.counts[tile, cell] = before + np.uint16(1)
            else:
                _visit_hit(tiles, tile, cell)


@kernel
def _visit_hit(tiles, tile, cell):
    """Count a visit in a cell that was hit before, or that is full."""
    before = np.int64(tiles.counts[tile, cell])
    seen, hits = (before & 255) + 1, before >> 8
    if 4 * hits <= seen:
        tiles.surface[tile, cell, MEAN_X] = FREE
    if seen > _SATURATED:
        hits >>= 1
        seen >>= 1
    tiles.counts[tile, cell] = np.uint16(hits << 8 | seen)


@kernel
def _hit(tiles, i, x, y):
    """Count an end point; a cell that becomes occupied is announced to the cells around it."""
    cx, cy = int(np.floor(x)), int(np.floor(y))
    tile = tiles.index[i, cy >> BITS, cx >> BITS]
    cell = ((cy & (SIDE - 1)) << BITS) | (cx & (SIDE - 1))
    before = np.int64(tiles.counts[tile, cell])
    visits, hits = (before & 255) + 1, (before >> 8) + 1
    if visits > _SATURATED:
        hits >>= 1
        visits >>= 1
    tiles.counts[tile, cell] = np.uint16(hits << 8 | visits)
    if hits == 1:
        tiles.mean[tile, cell, 0] = x - cx
        tiles.mean[tile, cell, 1] = y - cy
    else:
        tiles.mean[tile, cell, 0] += (x - cx - tiles.mean[tile, cell, 0]) / hits
        tiles.mean[tile, cell, 1] += (y - cy - tiles.mean[tile, cell, 1]) / hits
    if 4 * hits <= visits:
        return
    fresh = tiles.surface[tile, cell, MEAN_X] == FREE
    tiles.surface[tile, cell, MEAN_X] = np.uint8(tiles.mean[tile, cell, 0] * 254 + 0.5)
    tiles.surface[tile, cell, MEAN_Y] = np.uint8(tiles.mean[tile, cell, 1] * 254 + 0.5)
    # a neighbour may still point at a nearer cell that has become free: announce this one again now and then
    heal = hits == 8 or hits == 64 or hits == 512
    if fresh or heal:
        if heal:
            _forget_freed(tiles, i, cx, cy)
        _announce(tiles, i, cx, cy)


@kernel
def _announce(tiles, i, cx, cy):
    """Point the cells within REACH at the occupied cell (cx, cy) unless they know a nearer one."""
    for dy in range(-REACH, REACH + 1):
        y, high = cy + dy, dy * dy
        half = int(np.sqrt(REACH * REACH - high))
        row = (y & (SIDE - 1)) << BITS
        x, last = cx - half, cx + half
        while x <= last:
            tile = np.uintp(tiles.index[i, y >> BITS, x >> BITS])
            stop = min(last, x | (SIDE - 1))
            first = np.uintp(row | (x & (SIDE - 1)))
            for k in range(stop - x + 1):
                dx = x + k - cx
                cell = first + np.uintp(k)
                if dx * dx + high < squared_distance(tiles, tile, cell):
                    tiles.surface[tile, cell, OFF_X] = REACH - dx
                    tiles.surface[tile, cell, OFF_Y] = REACH - dy
            x = stop + 1


@kernel
def _forget_freed(tiles, i, cx, cy):
    """Cells around (cx, cy) whose nearest occupied cell has become free know none any more."""
    for y in range(cy - REACH, cy + REACH + 1):
        for x in range(cx - REACH, cx + REACH + 1):
            tile = tiles.index[i, y >> BITS, x >> BITS]
            cell = ((y & (SIDE - 1)) << BITS) | (x & (SIDE - 1))
            off_x = tiles.surface[tile, cell, OFF_X]
            if off_x == NONE or (x - cx) ** 2 + (y - cy) ** 2 > REACH * REACH:
                continue
            ox, oy = x + np.int64(off_x) - REACH, y + np.int64(tiles.surface[tile, cell, OFF_Y]) - REACH
            other = tiles.index[i, oy >> BITS, ox >> BITS]
            if tiles.surface[other, ((oy & (SIDE - 1)) << BITS) | (ox & (SIDE - 1)), MEAN_X] == FREE:
                tiles.surface[tile, cell, OFF_X] = NONE


@kernel
def classify(tiles, i):
    """Cells of particle i as int8 (rows, cols) of its whole table: 0 free, 1 occupied, -1 unknown."""
    _, rows, cols = tiles.index.shape
    out = np.full((rows * SIDE, cols * SIDE), -1, np.int8)
    for r in range(rows):
        for c in range(cols):
            tile = tiles.index[i, r, c]
            if tile < 0:
                continue
            for k in range(CELLS):
                if tiles.counts[tile, k] > 0:
                    occupied = tiles.surface[tile, k, MEAN_X] != FREE
                    out[r * SIDE + (k >> BITS), c * SIDE + (k & (SIDE - 1))] = 1 if occupied else 0
    return out


def used(tiles: Tiles) -> int:
    """How many tiles the particles hold together."""
    return int(tiles.refs.size - tiles.top[0])
