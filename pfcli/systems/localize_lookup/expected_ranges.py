"""The map in the two forms in which ranges are expected of it: a table, and rays cast on the spot."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid import raycast
from pfcli.core.grid.grid_map import GridMap
from pfcli.core.grid.region import region_of
from pfcli.core.sensor import range_beams, range_table
from pfcli.core.sensor.range_beams import Beams, Model, Rays
from pfcli.core.sensor.range_table import RangeTable
from pfcli.errors import LogError, UsageError
from pfcli.formats import map_yaml, range_table_file
from pfcli.initial import Initial
from pfcli.systems.localize_lookup.params import Params
from pfcli.systems.shared.contract import Job
from pfcli.systems.shared.start_cells import start_cells


class Assets(NamedTuple):
    """The map; cells (k, 2) in which the robot may stand at the start, and at all; rays, and the table where there is one;
    where the ranges come from, in words; wall_m: how thick its walls are drawn."""

    grid: GridMap
    start_xy: NDArray[np.float64]
    free_xy: NDArray[np.float64]
    rays: Rays
    table: RangeTable | None
    initial: Initial
    source: str
    wall_m: float


def load(params: Params, job: Job) -> Assets:
    """Read the map and its table. Raises LogError where nobody could stand in it, UsageError for a start outside or shares of
    beams that are more than all."""
    if params.z_hit + params.z_short + params.z_none >= 1.0:
        raise UsageError("--z-hit, --z-short and --z-none must leave something of 1 for beams that read anything")
    grid = map_yaml.read(job.map_file, job.max_map_mpx, job.unknown_grey)
    region = region_of(grid.cells, grid.resolution_m, grid.origin, 0.0)
    if region.free_xy.size == 0:
        raise LogError(f"{job.map_file}: has no free cells")
    if not (grid.cells == 1).any():
        raise LogError(f"{job.map_file}: has no occupied cells, so no range can be expected of it")
    initial: Initial = job.initial
    if initial.kind == "outside":
        raise UsageError("--initial outside: localize-lookup knows no outside; localize-partial does")
    seen = grid._replace(cells=raycast.unveiled(grid.cells, grid.resolution_m, params.veil_m))
    rays = range_beams.rays_of(seen.cells, grid.resolution_m, grid.origin, params.table_range_m)
    table, source = None, "rays"
    needed = range_table.bytes_of(seen.cells, params.bins) / 2**20
    if params.ranges == "table" and needed > params.table_budget_mib:
        source = f"rays: the table would take {needed:.0f} MiB, more than --table-budget-mib"
    elif params.ranges == "table":
        loaded = range_table_file.load(seen, params.bins, params.table_range_m)
        table, source = loaded.table, f"table, {loaded.origin}"
    return Assets(
        grid=grid,
        start_xy=start_cells(region, initial, job.map_file),
        free_xy=region.free_xy,
        rays=rays,
        table=table,
        initial=initial,
        source=source,
        wall_m=raycast.wall_thickness_m(grid.cells, grid.resolution_m),
    )


def evidence(poses: NDArray[np.float64], beams: Beams, assets: Assets, model: Model) -> NDArray[np.float64]:
    """(n,) log p(z | x) of poses (n, 3), up to a constant. Zhang 2014, eq. (13)."""
    if assets.table is None:
        return range_beams.from_rays(poses, beams, assets.rays, model)
    return range_beams.from_table(poses, beams, assets.table, model)


def expected_m(xy: NDArray[np.float64], bins: int, assets: Assets) -> NDArray[np.float32]:
    """(n, bins) expected range from places (n, 2) along every direction of the grid; the table's range where nothing is
    hit, NaN where the map says nothing."""
    if assets.table is not None:
        return range_table.rows_around(assets.table, xy)
    return raycast.cast_around(assets.rays.room, assets.rays.cells, assets.rays.frame, xy, bins, assets.rays.range_m)
