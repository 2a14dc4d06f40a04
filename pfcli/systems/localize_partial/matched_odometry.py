"""How the robot has moved: by odometry, made better by what its scans have in common with those of the last metres.

Outside the map nothing else tells where the robot is, and wheels that slip or are not calibrated lose it within a few rooms.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.grid.coarse_search import Window
from pfcli.core.grid.scan_match import Matcher
from pfcli.core.grid.scan_odometry import TURN_M, ScanOdometry, Setup
from pfcli.core.grid.tiles import Beams
from pfcli.systems.localize_partial.params import Params
from pfcli.systems.shared.motion_gate import noise_of

_MATCHER = Matcher(map_normals=True, tangent=0.0)
"""Along a plain wall a scan says nothing: what pulls there is where the local map happens to end."""
_WINDOW = Window(
    half_xy_m=0.3, half_yaw_rad=0.35, step_xy_m=0.15, step_yaw_rad=0.035, sigma_m=0.12, beams=50, gain=0.005
)
CELL_M = 0.05
"""Side of a cell of the local map."""
_DRAW_INLIERS = 0.5
_ASTRAY_M = 1.0
"""After so much way (and turns) on which no scan fits those before, the last metres are forgotten: the robot was carried."""
_TIGHTER = 0.25
"""Share of the particles' noise along the way by which odometry errs while no wheel slips: what people who walk along pull by."""


class Reckoning(NamedTuple):
    """pose (3,) in the frame of the first scan, by odometry and scans; scans: what matches them, None before the first;
    astray_m: way on which no scan has fitted those before; anew: the last metres are forgotten here."""

    pose: NDArray[np.float64] = np.zeros(3)
    scans: ScanOdometry | None = None
    astray_m: float = 0.0
    anew: bool = False


def reckon(
    before: Reckoning, scan: Beams, moved: NDArray[np.float64], way_m: float, params: Params
) -> tuple[Reckoning, NDArray[np.float64]]:
    """After a step (3,) of the odometry, of so much way: (the pose, the step as scans and odometry have it)."""
    if not params.match_scans or params.variant == "paper":
        return before._replace(pose=compose(before.pose[None], moved[None])[0]), moved
    noise = noise_of(params)
    setup = Setup(_MATCHER, _WINDOW, noise, CELL_M, _DRAW_INLIERS)
    if before.scans is None:
        return before._replace(scans=ScanOdometry(setup, scan, before.pose)), moved
    rolling = noise._replace(xy_per_m=_TIGHTER * noise.xy_per_m, xy_m=_TIGHTER * noise.xy_m)
    way_m += TURN_M * abs(float(moved[2]))
    found = before.scans.step(scan, moved, way_m, rolling)
    step = between(before.pose[None], found.pose[None])[0]
    astray_m = 0.0 if found.fits else before.astray_m + way_m
    if astray_m > _ASTRAY_M:
        return Reckoning(found.pose, ScanOdometry(setup, scan, found.pose), 0.0, True), step
    return Reckoning(found.pose, before.scans, astray_m), step
