"""W204: the motion source turns otherwise than the scans do."""

import math

import numpy as np

from pfcli.checks import clock_lag
from pfcli.checks.agreement import DEGREES, factor_of
from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding


def turn_factor(evidence: Evidence) -> float | None:
    """By which factor the motion source turns more than the scans say; None where it cannot be said, or a lag explains it."""
    pairs = evidence.pairs
    good = pairs.inliers > 0.6
    factor = factor_of(pairs.by_motion[good, 2], pairs.by_scans[good, 2])
    if factor is not None and math.isnan(factor) and clock_lag.check(evidence) is not None:
        return None
    return factor


def check(evidence: Evidence) -> Finding | None:
    """Between scans the robot turns otherwise by its motion source than by the scans: a unit, a sign, a wheel base."""
    factor = turn_factor(evidence)
    if factor is None or 0.8 < factor < 1.25 or factor == -1.0:
        return None
    if abs(abs(factor) - DEGREES) < 1.0:
        seen, way_out = "turns by 57.3 times what the scans say: degrees are read as radians", "give yaw in radians"
    elif abs(abs(factor) * DEGREES - 1.0) < 0.05:
        seen, way_out = "turns by a 57th of what the scans say: radians were converted twice", "give yaw in radians"
    elif factor == 0.0:
        if np.ptp(evidence.motion[:, 1:3], axis=0).max() < 0.1:
            return None  # it stands still altogether, which is another finding
        seen, way_out = "never turns, and the scans do", "give its heading; --motion names another source"
    elif math.isnan(factor):
        seen = "turns have nothing to do with those of the scans"
        way_out = "look at its heading and at the clocks (--time log, --time-offset); another source: --motion"
    else:
        seen = f"turns by {factor:.2f} times what the scans say"
        way_out = "wheels: --track-width-m, --wheel-radius-m; scans: field 'angle_increment'"
    count = int((np.abs(evidence.pairs.by_scans[:, 2]) > math.radians(2)).sum())
    return Finding(
        code="W204",
        severity="doubt",
        where=_source(evidence),
        seen=f"{seen} ({count} turns looked at)",
        effect="headings are wrong after the first turn",
        way_out=way_out,
    )


def _source(evidence: Evidence) -> str:
    return next((evidence.where[r] for r in ("odometry", "encoders", "twist", "imu") if r in evidence.where), "")
