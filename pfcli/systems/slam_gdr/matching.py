"""What scans are matched with: points, matcher and coarse search, as the parameters say."""

import numpy as np

from pfcli.core.grid import scan_match
from pfcli.core.grid.coarse_search import Window
from pfcli.core.grid.scan_odometry import Setup
from pfcli.core.grid.scan_points import Points, points_of
from pfcli.core.sensor.usable_range import usable_m
from pfcli.events import Sweep
from pfcli.systems.shared.motion_gate import noise_of
from pfcli.systems.slam_gdr.params import Params


def points(sweep: Sweep, params: Params) -> Points:
    """End points of a scan in the base frame (m); at most `max_beams` of them."""
    scan = sweep.scan
    high = usable_m(scan.range_max_m, params.max_range_m)
    stride = -(-scan.ranges_m.size // params.max_beams) or 1
    return points_of(
        scan.ranges_m,
        (scan.angle_min_rad, scan.angle_increment_rad),
        (scan.range_min_m, high),
        scan.mount,
        stride,
        min(params.clear_no_return_m, high),
        params.resolution_m,
        scan.bearings_rad,
    )


def matcher(params: Params) -> scan_match.Matcher:
    """Constants of the match."""
    return scan_match.Matcher(
        sigma_m=params.sigma_hit_m,
        wide_m=params.match_width_m,
        gain=params.beam_gain,
        coarse_xy_m=params.coarse_xy_m,
        coarse_yaw_rad=float(np.radians(params.coarse_yaw_deg)),
        beam_width_rad=float(np.radians(params.beam_width_deg)),
    )


def near(params: Params) -> Window:
    """The coarse search around the odometry.

    Its beam count still sees a room; a gain below `gain` is not worth a second start: there odometry is as good.
    """
    return Window(
        half_xy_m=params.coarse_xy_m,
        half_yaw_rad=float(np.radians(params.coarse_yaw_deg)),
        step_xy_m=0.15,
        step_yaw_rad=0.035,
        sigma_m=0.12,
        beams=50,
        gain=0.005,
    )


def setup(params: Params) -> Setup:
    """All of it, for odometry from scans."""
    return Setup(matcher(params), near(params), noise_of(params), params.resolution_m, params.draw_inliers)
