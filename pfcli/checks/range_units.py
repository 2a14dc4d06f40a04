"""W301: ranges in another unit."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_FAR_M, _NEAR_M = 60.0, 0.06


def check(evidence: Evidence) -> Finding | None:
    """Half of what a range finder measures is farther than lasers see, or nearer than a hand."""
    for where, ranges in _ranges(evidence):
        if ranges.size < 50:
            continue
        middle = float(np.median(ranges))
        if _NEAR_M < middle < _FAR_M:
            continue
        guess = "mm" if middle > 500 else "cm" if middle > _FAR_M else "km, or metres converted twice"
        return Finding(
            code="W301",
            severity="doubt",
            where=f"{where}, field 'ranges'",
            seen=f"half of its readings are {'farther' if middle > 1 else 'nearer'} than {middle:.4g} m: {guess}?",
            effect="nothing fits a map, and a map grows without end",
            way_out="give metres, range_min and range_max too",
        )
    return None


def _ranges(evidence: Evidence) -> "list[tuple[str, np.ndarray[tuple[int], np.dtype[np.float64]]]]":
    found = []
    scans = evidence.samples.scans
    if scans:
        rows = [scan.ranges_m[(scan.ranges_m > 0) & (scan.ranges_m < scan.range_max_m)] for scan in scans]
        found.append((evidence.where.get("scan", ""), np.concatenate(rows).astype(float)))
    for topic, kept in evidence.range_rows.items():
        low, high = evidence.range_limits[topic]
        row = kept.rows()[:, 0]
        found.append((f"{evidence.path}: topic {topic!r}", row[(row > max(low, 0)) & (row < high)]))
    return found
