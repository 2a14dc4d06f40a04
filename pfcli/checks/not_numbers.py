"""W211: readings of motion that are not numbers."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding


def check(evidence: Evidence) -> Finding | None:
    """Poses of the odometry that are NaN."""
    rows = evidence.odometry
    bad = ~np.isfinite(rows[:, 1:4]).all(axis=1)
    if not bad.any():
        return None
    return Finding(
        code="W211",
        severity="loss",
        where=evidence.where.get("odometry", ""),
        seen=f"{int(bad.sum())} of {len(rows)} poses are not numbers",
        effect="readings there have no motion",
        way_out="--motion names another source",
    )
