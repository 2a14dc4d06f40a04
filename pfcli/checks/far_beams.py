"""W302: single beams far beyond the others."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.core.sensor.usable_range import FARTHEST_M
from pfcli.findings import Finding


def check(evidence: Evidence) -> Finding | None:
    """Some beams of the scans looked at end farther away than any laser scanner sees: they count as no return."""
    scans = evidence.samples.scans
    far = [float(r) for scan in scans for r in _far(scan.ranges_m, scan.range_max_m)]
    count = sum(scan.ranges_m.size for scan in scans)
    if not far or len(far) > 0.3 * count:
        return None
    return Finding(
        code="W302",
        severity="note",
        where=f"{evidence.where.get('scan', '')}, field 'ranges'",
        seen=f"{len(far)} of {count} beams looked at are farther than {FARTHEST_M:g} m, up to {max(far):.4g} m",
        effect="they count as no return",
        way_out="--max-range-m says how far the sensor sees",
    )


def _far(
    ranges: "np.ndarray[tuple[int], np.dtype[np.float32]]", high: float
) -> "np.ndarray[tuple[int], np.dtype[np.float32]]":
    return ranges[np.isfinite(ranges) & (ranges > FARTHEST_M) & (ranges < high)]
