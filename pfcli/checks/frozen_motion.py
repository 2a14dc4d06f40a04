"""W209: the motion source stands still while the scans move."""

import math

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_FEWEST, _SHARE = 4, 0.08


def check(evidence: Evidence) -> Finding | None:
    """Scans say that the robot drives or turns, and the motion source that it stands."""
    pairs = evidence.pairs
    if not len(pairs.stamps):
        return None
    # two moments of one pose fit each other as well as a driven pair: what stands must fit worse unmoved
    turned = np.abs(pairs.by_scans[:, 2]) > math.radians(3)
    driven = (np.hypot(*pairs.by_scans[:, :2].T) > 0.08) & (pairs.held > 0.15)
    moving = (pairs.inliers > 0.75) & (turned | driven)
    still = (np.hypot(*pairs.by_motion[:, :2].T) < 0.002) & (np.abs(pairs.by_motion[:, 2]) < math.radians(0.1))
    frozen = int((moving & still).sum())
    if frozen < _FEWEST or frozen < _SHARE * moving.sum():
        return None
    source = next((evidence.where[r] for r in ("odometry", "encoders", "twist", "imu") if r in evidence.where), "")
    return Finding(
        code="W209",
        severity="doubt",
        where=source,
        seen=f"stands still in {frozen} of {int(moving.sum())} pairs of scans that show a moving robot",
        effect="the way is too short there, and the map is drawn over itself",
        way_out="--motion names another source; --start and --end leave that part out",
    )
