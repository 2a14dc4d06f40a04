"""What is used of a reading, and the map in the two forms in which ranges are expected of it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.grid_map import GridMap
from pfcli.core.grid.raycast import cast_around
from pfcli.core.sensor import range_beams, range_table
from pfcli.core.sensor.range_beams import Beams, Model, Rays
from pfcli.core.sensor.range_table import RangeTable
from pfcli.events import Sounding, Sweep
from pfcli.initial import Initial
from pfcli.systems.localize_lookup.params import Params


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
    return cast_around(assets.rays.room, assets.rays.cells, assets.rays.frame, xy, bins, assets.rays.range_m)


def model_of(params: Params, beams: Beams, assets: Assets, sigma_m: float) -> Model:
    """The beam model of a variant with this spread of hits."""
    if params.variant == "paper":
        return range_beams.gaussian(sigma_m)
    gain = min(1.0, params.independent_beams / max(1, beams.turn.size))
    shares = range_beams.Shares(params.z_hit, params.z_short, params.z_none)
    return range_beams.mixture(sigma_m, shares, params.reach_m, gain, assets.wall_m)


def beams_of(reading: Sweep | Sounding, params: Params) -> Beams:
    """Beams of a scan or of the range finders; those that say nothing are left out."""
    if isinstance(reading, Sounding):
        heard = reading.ranges
        used, z = _usable(heard.ranges_m, heard.range_min_m, heard.range_max_m, params)
        return range_beams.beams_of(heard.mounts[used], np.ones(z.size, np.int64), np.zeros(z.size), z)
    scan = reading.scan
    stride = max(1, -(-scan.ranges_m.size // params.beams))
    used, z = _usable(scan.ranges_m[::stride], scan.range_min_m, scan.range_max_m, params)
    angles = scan.angle_min_rad + scan.angle_increment_rad * stride * np.flatnonzero(used)
    mount = np.array([scan.mount], np.float64)
    return range_beams.beams_of(mount, np.array([z.size]), np.asarray(angles, np.float64), z)


def _usable(
    ranges: NDArray[np.float32], low: float | NDArray[np.float32], high: float | NDArray[np.float32], params: Params
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Which beams say something (n,), and what (k,): a range, or infinity for nothing within reach."""
    limit = np.minimum(high, min(params.max_range_m or np.inf, params.table_range_m))
    z = np.where(ranges >= limit, np.float32(np.inf), ranges)
    used = (z > np.maximum(low, 0.0)) & (np.isfinite(z) | params.no_return)
    return used, z[used].astype(np.float32)
