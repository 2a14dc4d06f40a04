"""Speed of localize-lookup: look-ups, table, whole updates against rays cast on the spot, in one run.

python benchmarks/lookup_speed.py
"""

import statistics
import time
from collections.abc import Callable

import lookup_world
import numpy as np
import worlds

from pfcli.core.grid.raycast import clearance
from pfcli.core.jit import kernel
from pfcli.core.sensor import range_beams
from pfcli.core.threads import set_threads
from pfcli.formats import map_yaml, range_table_file
from pfcli.params import build
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


@kernel
def walk(cells, x, y, turn, reach):  # type: ignore[no-untyped-def]
    """The textbook ray: cell by cell (Amanatides and Woo 1987)."""
    out = np.empty(x.size)
    for k in range(x.size):
        ux, uy = np.cos(turn[k]), np.sin(turn[k])
        ix, iy = int(x[k]), int(y[k])
        sx, sy = (1 if ux > 0 else -1), (1 if uy > 0 else -1)
        dx, dy = abs(1.0 / ux), abs(1.0 / uy)
        tx = ((ix + 1 if ux > 0 else ix) - x[k]) / ux
        ty = ((iy + 1 if uy > 0 else iy) - y[k]) / uy
        t = 0.0
        while t < reach and 0 <= ix < cells.shape[1] and 0 <= iy < cells.shape[0] and cells[iy, ix] != 1:
            if tx < ty:
                t, tx, ix = tx, tx + dx, ix + sx
            else:
                t, ty, iy = ty, ty + dy, iy + sy
        out[k] = t
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
    taken = {}
    for name in ("table", "rays"):
        params = build(lookup_world.LOOKUP.params, {"ranges": name, "beams": 180}, "b")
        assets, draw, state, seconds = lookup_world.load(world, params), Draw(0), None, []
        for reading in world.readings[:300]:
            if state is None:
                state = lookup_world.LOOKUP.init(params, assets, reading, draw)
            began = time.perf_counter()
            state, info = lookup_world.LOOKUP.step(state, reading, assets, params, draw)
            if info is not None:
                seconds.append(time.perf_counter() - began)
        taken[name] = statistics.median(seconds[5:])
        print(f"  {name}: {taken[name] * 1e3:.2f} ms")
    print(f"  ratio {taken['rays'] / taken['table']:.1f}")


if __name__ == "__main__":
    main()
