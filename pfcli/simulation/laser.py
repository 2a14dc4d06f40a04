"""Ray casting against wall segments and moving discs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import kernel


class Laser(NamedTuple):
    """A scanner: beams over `view_deg`, range (m), noise (m), mount x, y, yaw (m, rad), rate (Hz); rings_deg: elevations of its
    planes, of one that sees in space, at height_m above the floor."""

    beams: int
    view_deg: float
    range_m: float
    noise_m: float
    mount: tuple[float, float, float]
    rate_hz: float
    rings_deg: tuple[float, ...] = ()
    height_m: float = 0.0


LASERS = {
    "sick-1deg": Laser(181, 180.0, 30.0, 0.01, (0.1, 0.0, 0.0), 5.0),
    "sick-half": Laser(361, 180.0, 30.0, 0.01, (0.1, 0.0, 0.0), 5.0),
    "quarter": Laser(1081, 270.0, 25.0, 0.015, (0.2, 0.0, 0.0), 5.0),
    "urg-04lx": Laser(667, 240.0, 4.0, 0.01, (0.12, 0.0, 0.0), 5.0),
    "ring-360": Laser(360, 359.0, 12.0, 0.015, (0.0, 0.0, 0.0), 5.0),
    "off-centre": Laser(181, 180.0, 30.0, 0.01, (0.25, -0.15, 0.5), 5.0),
    "coarse-240": Laser(121, 240.0, 12.0, 0.01, (0.12, 0.0, 0.0), 5.0),
    "narrow": Laser(181, 90.0, 30.0, 0.01, (0.1, 0.0, 0.0), 5.0),
    "rings-16": Laser(
        900, 359.6, 30.0, 0.02, (0.1, 0.0, 0.0), 5.0, tuple(float(e) for e in range(-15, 16, 2)), height_m=0.6
    ),
}
"""Scanners by name; urg-04lx is the one of Zhang 2016, section 3.2 (240 deg, 0.36 deg, about 4 m)."""


@kernel
def cast(x, y, angles, walls, discs, reach, out):
    """Distance from (x, y) along each angle to the nearest wall (s, 4) or disc (d, 3: x, y, radius), `reach` if none."""
    near = np.empty(walls.shape[0], np.int64)
    count = 0
    for k in range(walls.shape[0]):
        low_x, high_x = min(walls[k, 0], walls[k, 2]) - reach, max(walls[k, 0], walls[k, 2]) + reach
        low_y, high_y = min(walls[k, 1], walls[k, 3]) - reach, max(walls[k, 1], walls[k, 3]) + reach
        if low_x <= x <= high_x and low_y <= y <= high_y:
            near[count] = k
            count += 1
    for b in range(angles.size):
        dx, dy = np.cos(angles[b]), np.sin(angles[b])
        best = reach
        for j in range(count):
            k = near[j]
            ex, ey = walls[k, 2] - walls[k, 0], walls[k, 3] - walls[k, 1]
            det = ex * dy - ey * dx
            if abs(det) < 1e-12:
                continue
            px, py = walls[k, 0] - x, walls[k, 1] - y
            t = (ex * py - ey * px) / det
            s = (dx * py - dy * px) / det
            if 0.0 < t < best and 0.0 <= s <= 1.0:
                best = t
        for j in range(discs.shape[0]):
            px, py = discs[j, 0] - x, discs[j, 1] - y
            along = px * dx + py * dy
            off2 = px * px + py * py - along * along
            room = discs[j, 2] * discs[j, 2] - off2
            if along > 0.0 and room > 0.0:
                t = along - np.sqrt(room)
                if 0.0 < t < best:
                    best = t
        out[b] = best


CEILING_M = 2.5


def rings(flat_m: NDArray[np.float64], laser: Laser) -> NDArray[np.float64]:
    """Ranges (rings, beams) along the beams of a scanner of many planes, of the distances (beams,) of the walls in the plane:
    a beam meets floor or ceiling where that is nearer; beyond the scanner's range: infinite."""
    up = np.radians(np.array(laser.rings_deg))[:, None]
    far = np.where(flat_m >= laser.range_m, np.inf, flat_m)[None, :] / np.cos(up)
    level = np.where(up < 0.0, -laser.height_m, CEILING_M - laser.height_m) / np.where(up == 0.0, 1e-9, np.sin(up))
    found = np.minimum(far, level)
    return np.where(found >= laser.range_m, np.inf, found)
