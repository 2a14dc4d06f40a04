"""W206: the twist of the odometry contradicts its pose."""

import numpy as np

from pfcli.checks.agreement import factor_of
from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_WINDOW_S = 1.0


def check(evidence: Evidence) -> Finding | None:
    """Turn and way by the twist against those by the pose; a twist of zeros is one that nobody filled in."""
    rows = evidence.odometry
    if len(rows) < 20 or not np.isfinite(rows[:, 4:]).all() or not np.abs(rows[:, 4:]).any():
        return None
    step = np.diff(rows[:, 0])
    way = np.concatenate([[0.0], np.cumsum(step * rows[1:, 4])])
    turn = np.concatenate([[0.0], np.cumsum(step * rows[1:, 6])])
    at = np.arange(rows[0, 0], rows[-1, 0], _WINDOW_S)
    yaw = np.unwrap(rows[:, 3])
    told = np.diff(np.interp(at, rows[:, 0], turn))
    factor = factor_of(told, np.diff(np.interp(at, rows[:, 0], yaw))) if np.abs(rows[:, 6]).any() else None
    index = np.searchsorted(rows[:, 0], at)
    gone = np.hypot(*np.diff(rows[index, 1:3], axis=0).T)
    moved = gone > 0.1
    ratio = float(np.median(np.abs(np.diff(way[index]))[moved] / gone[moved])) if moved.sum() >= 5 else 1.0
    if (factor is None or np.isnan(factor) or 0.5 < factor < 2.0) and 0.5 < ratio < 2.0:
        return None
    if ratio == 0.0:
        return None
    turns = "" if factor is None or np.isnan(factor) else f" and turns {factor:.3g} times as much"
    return Finding(
        code="W206",
        severity="note",
        where=evidence.where.get("odometry", ""),
        seen=f"its twist drives {ratio:.3g} times as far as its pose{turns}",
        effect="none where the pose is used; --motion odometry-twist would go wrong",
        way_out="leave --motion at odometry",
    )
