"""The incomplete map: what is free, where it can be entered, and how well end points lie on its surfaces."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.grid_map import GridMap
from pfcli.core.grid.region import Region, region_of
from pfcli.core.sensor import likelihood_field
from pfcli.errors import LogError, UsageError
from pfcli.formats import map_yaml
from pfcli.initial import Initial
from pfcli.systems.localize_partial.params import Params
from pfcli.systems.shared.contract import Job
from pfcli.systems.shared.start_cells import start_cells

_MIN_BAND_CELLS = 1.5
"""The band at a frontier is at least so wide, however short the step."""


class Assets(NamedTuple):
    """The map, its region, its likelihood field, and where to start."""

    grid: GridMap
    region: Region
    field: likelihood_field.Field
    initial: Initial
    start_xy: NDArray[np.float64]


def load(params: Params, job: Job) -> Assets:
    """Read the map. Raises LogError where nobody could be localised in it, UsageError for a start outside, or --no-smooth
    with --extend-map."""
    if params.extend_map and not params.smooth:
        raise UsageError("--extend-map draws where the whole log says that the robot was: leave out --no-smooth")
    grid = map_yaml.read(job.map_file, job.max_map_mpx, job.unknown_grey)
    origin = grid.origin
    region = region_of(grid.cells, grid.resolution_m, origin, params.robot_radius_m, params.pocket_m2)
    if region.free_xy.size == 0:
        raise LogError(
            f"{job.map_file}: has no free cells that a robot of --robot-radius-m {params.robot_radius_m:g} fits into"
        )
    initial: Initial = job.initial
    if region.edge_xy.size == 0 and initial.kind != "inside":
        raise LogError(
            f"{job.map_file}: has no frontier (free cells beside unknown ones), so nobody can enter or leave it;"
            " say --initial inside, or lower --robot-radius-m or --pocket-m2"
        )
    field = likelihood_field.build(
        grid.cells, grid.resolution_m, origin, model_of(params), unknown=params.model_unknown
    )
    return Assets(grid, region, field, initial, start_cells(region, initial, job.map_file))


def model_of(params: Params) -> likelihood_field.Model:
    """How end points spread around surfaces."""
    return likelihood_field.Model(params.sigma_hit_m, params.z_hit, params.reach_m)


def band_count(region: Region, moved: NDArray[np.float64], sd: NDArray[np.float64]) -> int:
    """How many of the cells near a frontier lie within one step of it, noise included."""
    reach = max(np.hypot(moved[0], moved[1]) + 2 * sd[0], _MIN_BAND_CELLS * region.resolution_m)
    return int(np.searchsorted(region.edge_m, reach, side="right"))
