"""Maps of tiles as grid maps."""

import numpy as np

from pfcli.core.grid import tiles
from pfcli.core.grid.grid_map import GridMap
from pfcli.events import Pose2


def grid_of(maps: tiles.Tiles, particle: int) -> GridMap:
    """A particle's map, cut to what it has seen."""
    cells = tiles.classify(maps, particle)
    rows, cols = np.flatnonzero((cells >= 0).any(axis=1)), np.flatnonzero((cells >= 0).any(axis=0))
    cut = cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    corner = maps.corner * tiles.SIDE
    x, y = (float(round(v * maps.resolution_m, 9)) for v in (corner[0] + cols[0], corner[1] + rows[0]))
    return GridMap(np.ascontiguousarray(cut), maps.resolution_m, Pose2(x, y, 0.0))
