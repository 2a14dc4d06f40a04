"""W303: limits of the range finder that cannot be."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding


def check(evidence: Evidence) -> Finding | None:
    """range_max is zero, below range_min or below nearly all that was measured: in another unit, or not filled in."""
    scans = evidence.samples.scans
    if not scans:
        return None
    low, high = float(scans[0].range_min_m), float(scans[0].range_max_m)
    measured = np.concatenate([scan.ranges_m[np.isfinite(scan.ranges_m) & (scan.ranges_m > 0)] for scan in scans])
    if not measured.size:
        return None
    beyond, below = float((measured > high).mean()), float((measured < low).mean())
    if np.isnan(high) or high <= max(low, 0.0):
        seen = f"range_min is {low:g} and range_max {high:g} m"
    elif beyond > 0.9 and float(np.median(measured)) < 60:
        seen = f"{100 * beyond:.0f} % of the ranges lie beyond range_max, {high:g} m"
    elif below > 0.5:
        seen = f"{100 * below:.0f} % of the ranges lie below range_min, {low:g} m"
    else:
        return None
    return Finding(
        code="W303",
        severity="doubt",
        where=f"{evidence.where.get('scan', '')}, fields 'range_min' and 'range_max'",
        seen=seen,
        effect="readings count as no return or as invalid",
        way_out="--max-range-m says how far the sensor sees",
    )
