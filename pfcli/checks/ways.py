"""W205: the motion source goes farther, or less far, than the scans say."""

import numpy as np
from numpy.typing import NDArray

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_FEWEST = 8
_LOW, _HIGH = 0.6, 1.6
_UNITS = ((1000.0, "mm"), (100.0, "cm"), (3.281, "feet"), (39.37, "inches"), (0.001, "km"))


def moving(evidence: Evidence) -> NDArray[np.bool_]:
    """Pairs of scans between which both say that the robot moved along a direction that the scans hold."""
    pairs = evidence.pairs
    found: NDArray[np.bool_] = (
        (pairs.inliers > 0.6)
        & (pairs.held > 0.1)
        & (np.hypot(*pairs.by_scans[:, :2].T) > 0.03)
        & (np.abs(pairs.by_scans[:, 2]) < 0.3)
    )
    return found


def check(evidence: Evidence) -> Finding | None:
    """Between scans the robot goes another distance by its motion source than by the scans: a unit, a wheel radius."""
    chosen = moving(evidence)
    if chosen.sum() < _FEWEST:
        return None
    told = np.hypot(*evidence.pairs.by_motion[chosen, :2].T)
    factor = float(np.median(told / np.hypot(*evidence.pairs.by_scans[chosen, :2].T)))
    if _LOW < factor < _HIGH or factor < 0.02 * 0.001:
        return None
    if factor < 0.05 and abs(factor / 0.001 - 1) > 0.4 and abs(factor / 0.01 - 1) > 0.4:
        return None
    unit = next((name for size, name in _UNITS if abs(factor / size - 1) < 0.3), "")
    inverse = next((name for size, name in _UNITS[:4] if abs(factor * size - 1) < 0.3), "")
    guess = f": {unit} for metres" if unit else f": or the ranges are {inverse}" if inverse else ""
    source = next((evidence.where[r] for r in ("odometry", "encoders", "twist", "imu") if r in evidence.where), "")
    return Finding(
        code="W205",
        severity="doubt",
        where=source,
        seen=f"goes {factor:.3g} times as far as the scans say ({chosen.sum()} steps looked at){guess}",
        effect="the way and the map have the wrong size",
        way_out="give metres; wheels: --wheel-radius-m, --ticks-per-turn",
    )
