"""What the filter holds scans against: the map in all its forms, the models for a scanner, and what of a scan is used."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.free_space import Features, features_of
from pfcli.core.grid.grid_map import GridMap
from pfcli.core.grid.region import region_of
from pfcli.core.sensor import class_conditional
from pfcli.core.sensor.class_conditional import Field, Model, Scan
from pfcli.errors import LogError, UsageError
from pfcli.events import Sweep
from pfcli.formats import map_yaml
from pfcli.initial import Initial
from pfcli.systems.localize_reliable.params import Params
from pfcli.systems.localize_reliable.success_decision import View
from pfcli.systems.shared.contract import Job
from pfcli.systems.shared.start_cells import start_cells
from pfcli.systems.shared.usable_points import usable_points

_HIT_SIGMAS = 3.0


class Assets(NamedTuple):
    """The map in all forms: field of distances and rays, free-space features; where to start; digest of the map."""

    grid: GridMap
    field: Field
    features: Features
    start_xy: NDArray[np.float64]
    free_xy: NDArray[np.float64]
    initial: Initial
    digest: str


def load(params: Params, job: Job) -> Assets:
    """Read the map. Raises LogError where nobody could stand in it, UsageError for a start outside or shares of beams that are
    more than all."""
    if params.z_hit + params.z_rand > 1.0 + 1e-9:
        raise UsageError("--z-hit and --z-rand must not exceed 1 together")
    grid = map_yaml.read(job.map_file, job.max_map_mpx, job.unknown_grey)
    region = region_of(grid.cells, grid.resolution_m, grid.origin, 0.0)
    if region.free_xy.size == 0:
        raise LogError(f"{job.map_file}: has no free cells")
    if not (grid.cells == 1).any():
        raise LogError(f"{job.map_file}: has no occupied cells, so no scan can be compared with it")
    if job.initial.kind == "outside":
        raise UsageError("--initial outside: localize-reliable knows no outside; localize-partial does")
    field = class_conditional.build(grid.cells, grid.resolution_m, grid.origin)
    flat = grid._replace(origin=grid.origin._replace(yaw_rad=0.0))
    features = features_of(flat.cells != 0, flat.cells == 0, flat.resolution_m, flat.origin[:2])
    cells = start_cells(region, job.initial, job.map_file)
    return Assets(
        grid=grid,
        field=field,
        features=_turned(features, grid),
        start_xy=cells,
        free_xy=region.free_xy,
        initial=job.initial,
        digest=map_yaml.digest(grid),
    )


def _turned(features: Features, grid: GridMap) -> Features:
    """Features of a map whose grid is turned against its frame: places and gradient directions turn with it."""
    x, y, yaw = grid.origin
    if yaw == 0.0 or features.kind.size == 0:
        return features
    c, s = np.cos(yaw), np.sin(yaw)
    away = features.xy_m - [x, y]
    bins = features.slopes.shape[1]
    slopes = np.roll(features.slopes, round(yaw / (2 * np.pi) * bins), axis=1)
    return features._replace(xy_m=away @ np.array([[c, s], [-s, c]]) + [x, y], slopes=slopes)


def model_of(params: Params, range_m: float) -> Model:
    """The measurement model for a scanner of this range."""
    return Model(
        sigma_m=params.sigma_hit_m,
        z_hit=params.z_hit,
        z_rand=params.z_rand,
        known=params.known_prior,
        rate_per_m=params.unknown_rate_per_m,
        range_m=range_m,
        mae_top_m=params.mae_top_m,
        hit_m=_HIT_SIGMAS * params.sigma_hit_m,
        by_rays=params.range_model == "beam",
    )


def gain_of(params: Params, scan: Scan) -> float:
    """What one beam of a scan is worth."""
    return min(1.0, params.independent_beams / max(1, scan.range_m.size))


def reach_m(sweep: Sweep, params: Params) -> float:
    """The longest reading that is used."""
    return float(min(params.max_range_m or sweep.scan.range_max_m, 100.0))


class Usable(NamedTuple):
    """The beams that the filter uses, and all end points (b, 2) of the scan in the base frame (m)."""

    scan: Scan
    points: NDArray[np.float64]


def usable_scan(sweep: Sweep, params: Params) -> Usable | None:
    """The beams for the filter, and all end points for the global localiser; None where no beam returned."""
    found = usable_points(sweep, params)
    if found is None:
        return None
    points, sensor = found.ends, np.array(sweep.scan.mount[:2], np.float64)
    chosen = points[:: max(1, -(-points.shape[0] // params.beams))]
    return Usable(class_conditional.scan_of(chosen, sensor), points)


def view_of(sweep: Sweep, params: Params) -> View:
    """The sensor as the decision model sees it."""
    scan = sweep.scan
    stride = max(1, -(-scan.ranges_m.size // params.beams))
    angles = scan.angles_rad(stride)
    return View(np.array(scan.mount, np.float64), np.asarray(angles, np.float64), reach_m(sweep, params))
