"""What of a laser scan a filter uses."""

from typing import Any

from pfcli.core.grid.scan_points import Points, points_of
from pfcli.core.sensor.usable_range import usable_m
from pfcli.events import Sweep


def usable_points(
    sweep: Sweep, params: Any, most_beams: int | None = None, clear_m: float = 0.0, cell_m: float = 1.0
) -> Points | None:
    """The beams that returned within the usable range, as points in the base frame; None where there is none.

    params: of any system, with `max_range_m` (0: the scan's own limit); most_beams: every k-th beam is taken, so that there are
    no more than these; clear_m, cell_m: see `points_of`.
    """
    scan = sweep.scan
    high = usable_m(scan.range_max_m, params.max_range_m)
    stride = 1 if most_beams is None else -(-scan.ranges_m.size // most_beams) or 1
    angles, limits = (scan.angle_min_rad, scan.angle_increment_rad), (scan.range_min_m, high)
    points = points_of(scan.ranges_m, angles, limits, scan.mount, stride, min(clear_m, high), cell_m, scan.bearings_rad)
    return points if points.ends.shape[0] else None
