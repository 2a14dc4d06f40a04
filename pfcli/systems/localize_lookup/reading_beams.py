"""What is used of a reading, and what a beam says."""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.sensor import range_beams
from pfcli.core.sensor.range_beams import Beams, Model
from pfcli.events import Sounding, Sweep
from pfcli.systems.localize_lookup.expected_ranges import Assets
from pfcli.systems.localize_lookup.params import Params


def model_of(params: Params, beams: Beams, assets: Assets, sigma_m: float) -> Model:
    """The beam model of a variant with this spread of hits."""
    if params.variant == "paper":
        return range_beams.gaussian(sigma_m)
    gain = min(1.0, params.independent_beams / max(1, beams.turn.size))
    shares = range_beams.Shares(params.z_hit, params.z_short, params.z_none)
    return range_beams.mixture(sigma_m, shares, params.reach_m, gain, assets.wall_m)


def beams_of(reading: Sweep | Sounding, params: Params) -> Beams | None:
    """Beams of a scan or of the range finders; those that say nothing are left out. None where all do."""
    beams = _said(reading, params)
    return beams if beams.turn.size else None


def _said(reading: Sweep | Sounding, params: Params) -> Beams:
    if isinstance(reading, Sounding):
        heard = reading.ranges
        used, z = _usable(heard.ranges_m, heard.range_min_m, heard.range_max_m, params)
        return range_beams.beams_of(heard.mounts[used], np.ones(z.size, np.int64), np.zeros(z.size), z)
    scan = reading.scan
    stride = max(1, -(-scan.ranges_m.size // params.beams))
    used, z = _usable(scan.ranges_m[::stride], scan.range_min_m, scan.range_max_m, params)
    angles = scan.angle_min_rad + scan.angle_increment_rad * stride * np.flatnonzero(used)
    if scan.bearings_rad.size:
        angles = scan.bearings_rad[::stride][used]
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


def ends_of(beams: Beams) -> NDArray[np.float32]:
    """End points (b, 2) of the beams that returned, base frame."""
    origin = np.repeat(beams.mounts[:, :2], np.diff(beams.start), axis=0)
    back = np.isfinite(beams.range_m)
    return np.asarray((origin + (beams.range_m * beams.unit).T)[back], np.float32)
