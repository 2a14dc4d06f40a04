"""W402: points of lines in another unit."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_FAR_M, _NEAR_M = 30.0, 0.05


def check(evidence: Evidence) -> Finding | None:
    """Half of the line points lie farther away than a field is long."""
    if not evidence.lines or any(event.pixels for event in evidence.lines):
        return None
    points = np.concatenate([event.points_m for event in evidence.lines])
    far = float(np.median(np.hypot(*points.T)))
    if _NEAR_M < far < _FAR_M:
        return None
    return Finding(
        code="W402",
        severity="doubt",
        where=evidence.where.get("lines", ""),
        seen=f"half of its points lie {'farther' if far > 1 else 'nearer'} than {far:.4g} m",
        effect="none of them is on a line",
        way_out="give metres in the robot's frame; pixels: --px-per-cm and --image-centre",
    )
