"""W308: hardly a beam measures anything."""

import numpy as np

from pfcli.checks.evidence import Evidence, usable_limits
from pfcli.findings import Finding

_FEWEST = 8


def check(evidence: Evidence) -> Finding | None:
    """Half of the scans have fewer than eight usable beams."""
    counts = []
    for scan in evidence.samples.scans:
        low, high = usable_limits(scan)
        counts.append(int(((scan.ranges_m > low) & (scan.ranges_m < high)).sum()))
    if len(counts) < 5 or np.median(counts) >= _FEWEST or max(s.ranges_m.size for s in evidence.samples.scans) < 20:
        return None
    return Finding(
        code="W308",
        severity="doubt",
        where=evidence.where.get("scan", ""),
        seen=f"half of the scans have {np.median(counts):.0f} usable beams or fewer",
        effect="poses are those of the odometry",
        way_out="--max-range-m, or look at range_min and range_max",
    )
