"""How much of a scan is new: what the last key scans showed already is no fresh evidence of *where* the robot is.

An obstacle that the map lacks is seen by scan after scan. At a wrong place it may happen to lie along a mapped wall, and
does so again in every scan that sees it: one coincidence, not many. Only what comes into view tells places apart anew.
"""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.jit import kernel
from pfcli.events import Scan
from pfcli.systems.localize_reliable.sampler import KeyScan

_SAME_M, _SAME_RAD = 0.1, 0.02
"""An end point is not new within this of an earlier one: a distance, and an angle times its range."""


@kernel
def _unseen(ends, sensor, seen, same_m, same_rad):  # type: ignore[no-untyped-def]
    """How many end points (2, b) have none of `seen` (m, 2) near."""
    count = 0
    for b in range(ends.shape[1]):
        x, y = ends[0, b], ends[1, b]
        near = same_m + same_rad * np.hypot(x - sensor[0], y - sensor[1])
        best = 1e9
        for k in range(seen.shape[0]):
            dx, dy = seen[k, 0] - x, seen[k, 1] - y
            best = min(best, dx * dx + dy * dy)
        count += best > near * near
    return count


def share(
    ends: NDArray[np.float32], sensor: NDArray[np.float64], odometry: NDArray[np.float64], history: list[KeyScan]
) -> float:
    """Share of the end points (2, b), base frame (m), that no key scan showed; 1 where there is none.

    odometry: (1, 3) of the scan, in the frame of the key scans' odometry.
    """
    if not history:
        return 1.0
    earlier = [
        compose(between(odometry, k.odometry), np.column_stack([k.ends, np.zeros(len(k.ends))]))[:, :2] for k in history
    ]
    return float(_unseen(ends, sensor, np.concatenate(earlier), _SAME_M, _SAME_RAD) / ends.shape[1])


def turned_share(scan: Scan, odometry: NDArray[np.float64], history: list[KeyScan]) -> float:
    """Share of the view that a turn since the last key scan has brought in."""
    if not history:
        return 0.0
    view = abs(scan.angle_increment_rad) * scan.ranges_m.size
    return float(min(1.0, abs(between(history[-1].odometry, odometry)[0, 2]) / max(view, 1e-9)))
