"""The key scans of the last metres: what of a scan they showed already, and what they say of another place.

An obstacle that the map lacks is seen by scan after scan. At a wrong place it may happen to lie along a mapped wall, and
does so again in every scan that sees it: one coincidence, not many. Only what comes into view tells places apart anew.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.jit import kernel
from pfcli.core.sensor import class_conditional
from pfcli.core.sensor.class_conditional import Field, Model, Scan
from pfcli.events import Scan as LaserScan

_KEY_M, _KEY_RAD = 0.3, 0.5
_SAME_M, _SAME_RAD = 0.1, 0.02
"""An end point is not new within this of an earlier one: a distance, and an angle times its range."""


class KeyScan(NamedTuple):
    """odometry (1, 3) where it was taken; end points (b, 2) in the frame of the odometry (m); scan: the beams of them that
    are evidence; worth: what it says beyond the key scans before it, as a share of what a scan says."""

    odometry: NDArray[np.float64]
    ends: NDArray[np.float64]
    scan: Scan
    worth: float


def remember(history: list[KeyScan], scan: KeyScan, most: int) -> None:
    """Keep a scan that is far enough from the last one; at most `most`, in place."""
    if history:
        moved = between(history[-1].odometry, scan.odometry)[0]
        if np.hypot(moved[0], moved[1]) < _KEY_M and abs(moved[2]) < _KEY_RAD:
            return
    history.append(scan)
    del history[: max(0, len(history) - most)]


def placed(odometry: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(b, 2) points in the base frame where odometry (1, 3) was read, in the frame of the odometry."""
    return np.asarray(compose(odometry, _poses(points))[:, :2])


def seen_from(odometry: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(b, 2) points in the frame of the odometry, in the base frame where odometry (1, 3) was read."""
    return np.asarray(between(odometry, _poses(points))[:, :2])


def _poses(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([points, np.zeros(len(points))])


@kernel
def _unseen(ends, sensor, seen, same_m, same_rad):
    """How many end points (b, 2) have none of `seen` (m, 2) near."""
    count = 0
    for b in range(ends.shape[0]):
        x, y = ends[b, 0], ends[b, 1]
        near = same_m + same_rad * np.hypot(x - sensor[0], y - sensor[1])
        new = True
        for k in range(seen.shape[0] - 1, -1, -1):  # the newest scans saw most of it
            dx, dy = seen[k, 0] - x, seen[k, 1] - y
            if dx * dx + dy * dy <= near * near:
                new = False
                break
        count += new
    return count


def new_share(scan: Scan, odometry: NDArray[np.float64], history: list[KeyScan]) -> float:
    """Share of the beams of a scan whose end points no key scan showed; 1 where there is none.

    odometry: (1, 3) of the scan, in the frame of the key scans' odometry.
    """
    if not history:
        return 1.0
    here = placed(odometry, np.vstack([scan.sensor, scan.ends.T]))
    earlier = np.concatenate([k.ends for k in history])
    return float(_unseen(here[1:], here[0], earlier, _SAME_M, _SAME_RAD) / scan.ends.shape[1])


def turned_share(scan: LaserScan, odometry: NDArray[np.float64], history: list[KeyScan]) -> float:
    """Share of the view that a turn since the last key scan has brought in."""
    if not history:
        return 0.0
    view = abs(scan.angle_increment_rad) * scan.ranges_m.size
    return float(min(1.0, abs(between(history[-1].odometry, odometry)[0, 2]) / max(view, 1e-9)))


def past_evidence(
    poses: NDArray[np.float64],
    own: NDArray[np.float64],
    history: list[KeyScan],
    now: KeyScan,
    field: Field,
    model: Model,
    gain: float,
    top: float,
) -> NDArray[np.float64]:
    """(n,) what the key scans before `now` say for a robot at poses (n, 3) instead of `own` (3,), that came there as odometry
    tells: each as much as it showed something new, and `top` nats at the most."""
    total = np.zeros(poses.shape[0])
    both = np.vstack([poses, own])
    for key in history:
        if key is not now:
            there = compose(both, between(now.odometry, key.odometry))
            log = gain * class_conditional.fit(there, key.scan, field, model).log_likelihood
            total += np.clip(key.worth * (log[:-1] - log[-1]), -top, top)
    return total
