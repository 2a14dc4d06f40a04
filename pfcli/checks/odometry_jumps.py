"""W203: the odometry jumps."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_LEAST_M, _LEAST_RAD = 0.8, 1.2
_TIMES = 8.0


def check(evidence: Evidence) -> Finding | None:
    """A step of the odometry is much longer than its usual speed allows: it was reset, or a message is wrong."""
    rows = evidence.odometry
    if len(rows) < 20 or evidence.source != "odometry":
        return None
    step_s = np.maximum(np.diff(rows[:, 0]), 1e-3)
    way = np.hypot(*np.diff(rows[:, 1:3], axis=0).T)
    turn = np.abs(np.remainder(np.diff(rows[:, 3]) + np.pi, 2 * np.pi) - np.pi)
    usual_mps, usual_radps = (float(np.quantile(v / step_s, 0.95)) for v in (way, turn))
    far = (way > _LEAST_M) & (way > _TIMES * usual_mps * step_s + 0.2)
    round_ = (turn > _LEAST_RAD) & (turn > _TIMES * usual_radps * step_s + 0.3)
    jumps = np.flatnonzero(far | round_)
    if not jumps.size:
        return None
    k = int(jumps[np.argmax(way[jumps] + turn[jumps])])
    return Finding(
        code="W203",
        severity="doubt",
        where=evidence.where.get("odometry", ""),
        seen=f"{jumps.size} steps are no drive; the worst is {way[k]:.2f} m and {np.degrees(turn[k]):.0f} deg in"
        f" {step_s[k]:.3f} s, {rows[k, 0]:.1f} s after the start",
        effect="the robot seems to be carried there",
        way_out="--start/--end leave it out; --motion encoders or odometry-twist do without the pose",
    )
