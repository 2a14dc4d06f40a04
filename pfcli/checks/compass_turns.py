"""W208: the compass turns otherwise than the robot does."""

import math

import numpy as np

from pfcli.checks.agreement import DEGREES, factor_of
from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_WINDOW_S = 1.0


def check(evidence: Evidence) -> Finding | None:
    """Turns of the compass against those of the motion source, second by second."""
    rows, motion = evidence.compass, evidence.motion
    if len(rows) < 10 or len(motion) < 10:
        return None
    at = np.arange(max(rows[0, 0], motion[0, 0]), min(rows[-1, 0], motion[-1, 0]), _WINDOW_S)
    nearest = rows[np.clip(np.searchsorted(rows[:, 0], at), 0, len(rows) - 1)]
    driven = np.interp(nearest[:, 0], motion[:, 0], motion[:, 3])
    raw = np.diff(nearest[:, 1])
    told = np.remainder(raw + np.pi, 2 * np.pi) - np.pi
    factor = factor_of(told, np.diff(driven))
    if factor is None or 0.5 < factor < 2.0:
        return None
    if abs(abs(factor) - DEGREES) < 1.0:
        seen, way_out = "turns by 57.3 times what the motion says: degrees are read as radians", "give radians"
    elif factor == -1.0:
        seen, way_out = "turns the other way round than the motion", "give headings counter-clockwise"
    elif factor == 0.0:
        seen, way_out = "stands still while the robot turns", "leave it out: --topic compass=NAME of another"
    elif math.isnan(factor):
        seen, way_out = "has nothing to do with the turns of the motion", "give radians, counter-clockwise from x"
    else:
        seen, way_out = f"turns by {factor:.3g} times what the motion says", "give radians"
    return Finding(
        code="W208",
        severity="doubt",
        where=evidence.where.get("compass", ""),
        seen=seen,
        effect="it pulls the heading off",
        way_out=way_out,
    )
