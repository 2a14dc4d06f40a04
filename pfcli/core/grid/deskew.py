"""Beams that were measured while the robot moved, as one scan seen from where it was at one instant."""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import kernel


@kernel
def _place(ranges, bearings, mount, origin, reach, poses, reference, out_range, out_bearing):
    cr, sr = np.cos(reference[2]), np.sin(reference[2])
    for k in range(ranges.size):
        # the robot's pose at this beam, seen from the reference pose
        dx, dy = poses[k, 0] - reference[0], poses[k, 1] - reference[1]
        px, py, turn = cr * dx + sr * dy, -sr * dx + cr * dy, poses[k, 2] - reference[2]
        c, s = np.cos(turn), np.sin(turn)
        angle = bearings[k] + turn
        r = np.float64(ranges[k])
        if not r > reach[0] or r <= 0.0:
            out_range[k], out_bearing[k] = np.nan, angle
        elif r >= reach[1]:
            out_range[k], out_bearing[k] = np.inf, angle
        else:
            x = px + c * mount[0] - s * mount[1] + r * np.cos(angle) - origin[0]
            y = py + s * mount[0] + c * mount[1] + r * np.sin(angle) - origin[1]
            out_range[k], out_bearing[k] = np.sqrt(x * x + y * y), np.arctan2(y, x)


def deskewed(
    ranges_m: NDArray[np.floating],
    directions_rad: NDArray[np.float64],
    places_m: tuple[tuple[float, float], tuple[float, float]],
    reach_m: tuple[float, float],
    poses: NDArray[np.float64],
    reference: NDArray[np.float64],
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Ranges (n,) and directions (n,) from a place on the base at the reference pose to where each beam ended.

    directions_rad: (n,) of the beams in the base frame; places_m: the sensor on the base, and where it is
    seen from; reach_m: below is no measurement
    (NaN), beyond is no return (inf); poses: (n, 3) of the base at each beam; reference: (3,), in the same frame; headings
    without jumps of a turn.
    """
    out, bearing = np.empty(ranges_m.size), np.empty(ranges_m.size)
    given = np.array(ranges_m, np.float64)
    _place(given, directions_rad, *map(np.array, places_m), np.array(reach_m), poses, reference, out, bearing)
    return out.astype(np.float32), bearing
