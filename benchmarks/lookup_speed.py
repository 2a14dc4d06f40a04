"""Speed of localize-lookup: look-ups, table, whole updates against rays cast on the spot, in one run.

python benchmarks/lookup_speed.py
"""

import statistics
import time
from collections.abc import Callable
from typing import Any

import lookup_world
import numpy as np
import worlds

from pfcli.core.grid.raycast import clearance
from pfcli.core.jit import inline_kernel, kernel
from pfcli.core.sensor import range_beams
from pfcli.core.threads import set_threads, spread
from pfcli.formats import map_yaml, range_table_file
from pfcli.params import build
from pfcli.registry import filter_of
from pfcli.rng import Draw


def timed(work: Callable[[], object], repeats: int = 25) -> float:
    """Median seconds."""
    work()
    taken = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)


@inline_kernel
def _walk(cells, x, y, ux, uy, reach):  # type: ignore[no-untyped-def]
    """The textbook ray: cell by cell (Amanatides and Woo 1987); range in cells, infinite where nothing is hit."""
    ix, iy = int(x), int(y)
    sx, sy = (1 if ux > 0 else -1), (1 if uy > 0 else -1)
    dx, dy = abs(1.0 / ux), abs(1.0 / uy)
    tx = ((ix + 1 if ux > 0 else ix) - x) / ux
    ty = ((iy + 1 if uy > 0 else iy) - y) / uy
    t = 0.0
    while t < reach and 0 <= ix < cells.shape[1] and 0 <= iy < cells.shape[0]:
        if cells[iy, ix] == 1:
            return t
        if tx < ty:
            t, tx, ix = tx, tx + dx, ix + sx
        else:
            t, ty, iy = ty, ty + dy, iy + sy
    return np.inf


@kernel
def walk(cells, x, y, turn, reach):  # type: ignore[no-untyped-def]
    out = np.empty(x.size)
    for k in range(x.size):
        out[k] = _walk(cells, x[k], y[k], np.cos(turn[k]), np.sin(turn[k]), reach)
    return out


@kernel
def _walked_rows(low, high, poses, beams, cells, frame, yaw, model, reach, out):  # type: ignore[no-untyped-def]
    mounts, start, _, unit, z = beams
    score, steps, gain, _, wall_m, _ = model
    cell_m = 1.0 / np.hypot(frame[0], frame[3])
    for i in range(low, high):
        total = 0.0
        for j in range(mounts.shape[0]):
            x, y, heading = range_beams._sensor(poses[i], mounts[j], frame, yaw)
            c, s = np.cos(heading), np.sin(heading)
            for b in range(start[j], start[j + 1]):
                r = _walk(cells, x, y, c * unit[0, b] - s * unit[1, b], s * unit[0, b] + c * unit[1, b], reach / cell_m)
                d = z[b] - np.float32(r * cell_m if r < np.inf else 0.0)
                d -= min(max(d, np.float32(0.0)), wall_m)
                total += score[range_beams._slot(d, wall_m, True, r < np.inf, z[b], steps, np.int32(score.size))]
        out[i] = gain * total


def walked(poses: np.ndarray, beams: Any, rays: Any, model: Any) -> np.ndarray:
    """`range_beams.from_rays` with textbook rays."""
    out = np.empty(poses.shape[0])
    places = (rays.cells, rays.frame, rays.yaw_rad, range_beams._packed(model), rays.range_m)
    spread(_walked_rows, poses.shape[0], poses, tuple(beams), *places, out)
    return out


def main() -> None:
    grid = map_yaml.read(worlds.simulated("office").with_suffix(".yaml"))
    range_table_file.path_of(grid, 360, 30.0).unlink(missing_ok=True)
    began = time.perf_counter()
    loaded = range_table_file.load(grid, 360, 30.0)
    built = time.perf_counter() - began
    again = timed(lambda: range_table_file.load(grid, 360, 30.0), 5)
    mib = loaded.path.stat().st_size / 2**20
    print(f"table of {grid.cells.shape[1]} x {grid.cells.shape[0]} cells, 360 directions: built in {built:.1f} s")
    print(f"  {mib:.0f} MiB on disk, checked and mapped again in {again * 1e3:.0f} ms")
    rng = np.random.default_rng(0)
    n = 3500
    places = loaded.table.centre[rng.integers(loaded.table.centre.shape[0], size=n)] * grid.resolution_m
    spread_out = np.column_stack([places + np.array(grid.origin[:2]), rng.uniform(-np.pi, np.pi, n)])
    together = spread_out[:1] + rng.normal(0, [0.1, 0.1, 0.05], (n, 3))
    ranges = rng.uniform(1, 8, 180)
    beams = range_beams.beams_of(np.array([[0.1, 0, 0]]), np.array([180]), np.radians(np.arange(-90.0, 90)), ranges)
    model = range_beams.mixture(0.1, range_beams.Shares(0.5, 0.2, 0.05), 5.0, 1.0, 0.05)
    rays = range_beams.rays_of(grid.cells, grid.resolution_m, tuple(grid.origin), 30.0)
    set_threads(1)
    print("3500 particles x 180 beams, one core:")
    for name, poses in (("all over the map", spread_out), ("together", together)):
        looked = timed(lambda poses=poses: range_beams.from_table(poses, beams, loaded.table, model))
        cast = timed(lambda poses=poses: range_beams.from_rays(poses, beams, rays, model), 5)
        print(f"  {name}: table {n * 180 / looked / 1e6:.0f} M/s, rays in strides {n * 180 / cast / 1e6:.1f} M/s")
    k = rng.integers(loaded.table.centre.shape[0], size=100_000)
    x, y = loaded.table.centre[k].astype(float).T
    turn = rng.uniform(0.01, 6.27, 100_000)
    slow = timed(lambda: walk(grid.cells, x, y, turn, 600.0), 5)
    print(f"  textbook rays, cell by cell: {100_000 / slow / 1e6:.1f} M/s")
    assert clearance(grid.cells).shape == grid.cells.shape
    set_threads(0)
    whole()


def whole() -> None:
    """Whole updates on the office drive, 180 beams."""
    world = lookup_world.World("office", "scan")
    print("whole updates on the office drive, 3500 particles x 180 beams, both cores:")
    strided = range_beams.from_rays
    table = updates(world, "table")
    print(f"  table: {table * 1e3:.2f} ms")
    for label, rays in (("in strides", strided), ("cell by cell", walked)):
        range_beams.from_rays = rays
        cast = updates(world, "rays")
        print(f"  rays on line, {label}: {cast * 1e3:.2f} ms, ratio {cast / table:.1f}")
    range_beams.from_rays = strided


def updates(world: lookup_world.World, ranges: str) -> float:
    """Median seconds of an update."""
    params = build(lookup_world.LOOKUP.params, {"ranges": ranges, "beams": 180}, "b")
    assets, draw, state, seconds = lookup_world.load(world, params), Draw(0), None, []
    for reading in world.readings[:300]:
        if state is None:
            state = filter_of(lookup_world.LOOKUP).init(params, assets, reading, draw)
        began = time.perf_counter()
        state, info = filter_of(lookup_world.LOOKUP).step(state, reading, assets, params, draw)
        if info is not None:
            seconds.append(time.perf_counter() - began)
    return statistics.median(seconds[5:])


if __name__ == "__main__":
    main()
