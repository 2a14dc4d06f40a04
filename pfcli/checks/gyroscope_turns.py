"""W210: the gyroscope turns otherwise than the odometry does."""

import math

import numpy as np

from pfcli.checks.agreement import DEGREES, factor_of
from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_WINDOW_S = 1.0


def check(evidence: Evidence) -> Finding | None:
    """The integral of the gyroscope against the turn of the odometry, second by second."""
    rows, odometry = evidence.gyro, evidence.odometry
    if len(rows) < 20 or len(odometry) < 20 or not np.isfinite(rows).all():
        return None
    turn = np.concatenate([[0.0], np.cumsum(np.diff(rows[:, 0]) * 0.5 * (rows[1:, 1] + rows[:-1, 1]))])
    at = np.arange(max(rows[0, 0], odometry[0, 0]), min(rows[-1, 0], odometry[-1, 0]), _WINDOW_S)
    told = np.diff(np.interp(at, rows[:, 0], turn))
    factor = factor_of(told, np.diff(np.interp(at, odometry[:, 0], np.unwrap(odometry[:, 3]))))
    if factor is None or 0.7 < factor < 1.4:
        return None
    what = {-1.0: "the other way round than", 0.0: "not at all beside"}.get(factor, "")
    if abs(abs(factor) - DEGREES) < 1.0:
        what = "57.3 times as much (deg/s) as"
    what = what or ("without any relation to" if math.isnan(factor) else f"{factor:.3g} times as much as")
    return Finding(
        code="W210",
        severity="doubt",
        where=evidence.where.get("imu", ""),
        seen=f"turns {what} the odometry",
        effect="--motion imu would go wrong",
        way_out="rad/s, counter-clockwise; an upside-down one: give its roll in /tf_static; or --motion odometry",
    )
