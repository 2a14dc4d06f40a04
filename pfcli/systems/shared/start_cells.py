"""Where in its map a robot may stand at the start."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.region import Region, places, region_of
from pfcli.errors import UsageError
from pfcli.formats import map_yaml
from pfcli.initial import Initial

_NAMES = ("outside the map", "free", "in a wall")


def start_cells(region: Region, initial: Initial, map_file: Path) -> NDArray[np.float64]:
    """Centres (k, 2) of the cells in which the robot may stand. Raises UsageError where the start lies in none."""
    if initial.kind == "pose":
        place = _NAMES[int(places(region, np.array([initial.pose[:2]]))[0])]
        if place != "free":
            raise UsageError(
                f"--initial: ({initial.pose[0]:g}, {initial.pose[1]:g}) is {place} in {map_file}; choose a free place"
            )
    if initial.kind != "region":
        return region.free_xy
    assert initial.region is not None
    marked = map_yaml.read(initial.region)
    allowed = region_of(marked.cells, marked.resolution_m, marked.origin, 0.0)
    inside = places(allowed, region.free_xy) == 1
    if not inside.any():
        raise UsageError(f"--initial region:{initial.region}: none of its free cells is a free cell of the map")
    return np.asarray(region.free_xy[inside])
