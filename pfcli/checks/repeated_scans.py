"""W307: scans that repeat."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_FEWEST, _SHARE = 4, 0.08


def check(evidence: Evidence) -> Finding | None:
    """A scan is the same, to the last bit, as one a moment before, while the motion source moves."""
    pairs = evidence.pairs
    kept = [(a, b) for a, b in evidence.samples.pairs if a.ranges_m.size == b.ranges_m.size and a.ranges_m.size >= 20]
    if len(kept) != len(pairs.stamps) or not kept:
        return None
    moved = (np.hypot(*pairs.by_motion[:, :2].T) > 0.05) | (np.abs(pairs.by_motion[:, 2]) > 0.05)
    same = np.array([np.array_equal(a.ranges_m, b.ranges_m, equal_nan=True) for a, b in kept])
    count = int((same & moved).sum())
    if count < _FEWEST or count < _SHARE * moved.sum():
        return None
    return Finding(
        code="W307",
        severity="doubt",
        where=evidence.where.get("scan", ""),
        seen=f"{count} of {int(moved.sum())} scans looked at are those of a moment before, though the robot moved",
        effect="the robot seems to stand where it was",
        way_out="the driver repeats its last scan: --start and --end leave that part out",
    )
