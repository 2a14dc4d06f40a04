"""W305: the laser looks another way than its mount says."""

import math

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.checks.turns import turn_factor
from pfcli.checks.ways import moving
from pfcli.findings import Finding

_FEWEST = 8
_LEAST_RAD = math.radians(12)


def check(evidence: Evidence) -> Finding | None:
    """Where the robot drives, scans move in another direction than the motion source says."""
    chosen = moving(evidence) & (np.hypot(*evidence.pairs.by_motion[:, :2].T) > 0.03)
    if chosen.sum() < _FEWEST or turn_factor(evidence) == -1.0:
        return None
    scan, told = evidence.pairs.by_scans[chosen], evidence.pairs.by_motion[chosen]
    turned = np.exp(1j * (np.arctan2(scan[:, 1], scan[:, 0]) - np.arctan2(told[:, 1], told[:, 0])))
    mean = complex(turned.mean())
    off = float(np.angle(mean))
    if abs(mean) < 0.8 or abs(off) < _LEAST_RAD:
        return None
    mount = evidence.samples.scans[0].mount
    yaw = math.remainder(mount.yaw_rad - off, 2 * math.pi)
    back = "; or the motion drives backwards" if abs(off) > math.radians(160) else ""
    return Finding(
        code="W305",
        severity="doubt",
        where=evidence.where.get("scan", ""),
        seen=f"by {int(chosen.sum())} steps the laser looks {math.degrees(-off):.0f} deg aside of its mount"
        f" (yaw {mount.yaw_rad:.3f} rad){back}",
        effect="the map is smeared at every turn",
        way_out=f"--extrinsic base_link:FRAME={mount.x_m:g},{mount.y_m:g},{yaw:.3f}, FRAME as the scans name it",
    )
