"""W107: scans and motion do not belong to the same moment."""

import math

import numpy as np

from pfcli.checks.agreement import FEWEST, TURNING_RAD
from pfcli.checks.evidence import Evidence, Pairs
from pfcli.findings import Finding

_WIDEST_S, _STEP_S, _LEAST_S = 1.5, 0.02, 0.08
_GAIN = 0.55
_LEAST_RAD = math.radians(0.25)


def check(evidence: Evidence) -> Finding | None:
    """Turns by the scans match those of the motion source clearly better some time earlier or later."""
    lag_s, before, after = best_lag(evidence)
    if abs(lag_s) < _LEAST_S or after > _GAIN * before or before - after < _LEAST_RAD:
        return None
    return Finding(
        code="W107",
        severity="doubt",
        where=evidence.where.get("scan", str(evidence.path)),
        seen=f"turns match those of the motion {abs(lag_s):.2f} s {'earlier' if lag_s < 0 else 'later'}: mean difference"
        f" {math.degrees(before):.2f} -> {math.degrees(after):.2f} deg",
        effect="every scan is drawn with the heading of another moment",
        way_out=f"--time-offset scan={lag_s:.2f}",
    )


def best_lag(evidence: Evidence) -> tuple[float, float, float]:
    """The seconds that the scans' stamps should be later, and how far turns differ (rad) without and with them."""
    pairs = evidence.pairs
    good = pairs.inliers > 0.6
    turning = good & (np.maximum(np.abs(pairs.by_scans[:, 2]), np.abs(pairs.by_motion[:, 2])) > TURNING_RAD)
    if turning.sum() < FEWEST + 2:
        return 0.0, 0.0, 0.0
    lags = np.arange(-_WIDEST_S, _WIDEST_S + _STEP_S / 2, _STEP_S)
    costs = np.array([_difference(evidence, pairs, turning, lag) for lag in lags])
    best = int(np.argmin(costs))
    if best in (0, lags.size - 1):
        return 0.0, 0.0, 0.0
    return float(lags[best]), _difference(evidence, pairs, turning, 0.0), float(costs[best])


def _difference(
    evidence: Evidence, pairs: Pairs, chosen: "np.ndarray[tuple[int], np.dtype[np.bool_]]", lag: float
) -> float:
    seconds = (pairs.stamps[chosen] - (evidence.start_ns or 0)) * 1e-9 + lag
    rows = evidence.motion
    turn = np.interp(seconds[:, 1], rows[:, 0], rows[:, 3]) - np.interp(seconds[:, 0], rows[:, 0], rows[:, 3])
    return float(np.minimum(np.abs(turn - pairs.by_scans[chosen, 2]), 0.2).mean())
