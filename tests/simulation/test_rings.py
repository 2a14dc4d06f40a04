"""The simulated scanner of sixteen rings, and the slice of its cloud."""

from pathlib import Path

import numpy as np

from pfcli.events import Scan
from pfcli.replay.log import Log
from pfcli.simulation.laser import CEILING_M, LASERS, rings
from pfcli.simulation.scenario import Scenario, play, write


def test_beams_meet_the_nearest_of_wall_floor_and_ceiling() -> None:
    laser = LASERS["rings-16"]
    found = rings(np.array([2.0, 20.0, 1e9]), laser)
    up = np.radians(laser.rings_deg)
    heights = laser.height_m + found * np.sin(up)[:, None]
    assert (heights[np.isfinite(found)] > -1e-9).all()
    assert (heights[np.isfinite(found)] < CEILING_M + 1e-9).all()
    assert np.allclose(found[:, 0] * np.cos(up), 2.0)  # a wall near by is met by every ring
    assert np.isclose(found[0, 1], laser.height_m / np.sin(np.radians(15)))


def test_the_slice_of_the_cloud_is_what_a_flat_scanner_sees(tmp_path: Path) -> None:
    """Its rings at 1 degree see the walls 5 m away half as noisy as one of them."""
    scenario = Scenario("x", "four-rooms", "pioneer", "rings-16", duration_s=1.0)
    write(scenario, 0, tmp_path / "x.mcap")
    flat = next(iter(play(scenario._replace(laser="ring-360"), 0)))
    scan = next(e for e in Log(tmp_path / "x.mcap").events(["scan"]))
    assert isinstance(scan, Scan)
    seen = np.isfinite(scan.ranges_m)
    assert seen.mean() > 0.9
    # the flat scanner sits on the base, this one 0.1 m ahead
    x = scan.mount.x_m + scan.ranges_m[seen] * np.cos(scan.directions_rad()[seen])
    y = scan.mount.y_m + scan.ranges_m[seen] * np.sin(scan.directions_rad()[seen])
    assert flat.ranges_m is not None
    k = np.round((np.degrees(np.arctan2(y, x)) + 179.5) / (359 / 359)).astype(int).clip(0, 359)
    off = np.hypot(x, y) - flat.ranges_m[k]
    assert np.median(np.abs(off[np.isfinite(off)])) < 0.03
