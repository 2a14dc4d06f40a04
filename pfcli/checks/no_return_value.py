"""W306: a range within the limits that means no return."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_SHARE = 0.05
_BAND = 0.985


def check(evidence: Evidence) -> Finding | None:
    """Many beams have about the largest range of all, and few a little less: that is no wall, but a sensor that saw none."""
    scans = evidence.samples.scans
    if len(scans) < 5:
        return None
    rows = [scan.ranges_m[np.isfinite(scan.ranges_m) & (scan.ranges_m > 0)] for scan in scans]
    ranges = np.concatenate(rows).astype(float)
    if ranges.size < 500:
        return None
    top = float(ranges.max())
    high = float(scans[0].range_max_m)
    atom = float((ranges > _BAND * top).mean())
    below = float(((ranges > 0.7 * top) & (ranges <= _BAND * top)).mean())
    values = np.unique(ranges[ranges > _BAND * top]).size
    if atom < _SHARE or below > 0.25 * atom or _BAND * top >= high or (top >= high and values < 3) or top > high:
        return None
    return Finding(
        code="W306",
        severity="doubt",
        where=f"{evidence.where.get('scan', '')}, field 'ranges'",
        seen=f"{100 * atom:.0f} % of the beams are {_BAND * top:.2f} .. {top:.2f} m and hardly any a little less; range_max is"
        f" {high:g} m",
        effect="beams that met nothing are drawn as walls",
        way_out=f"--max-range-m {_BAND * top:.1f}",
    )
