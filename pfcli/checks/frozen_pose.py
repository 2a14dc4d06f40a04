"""W201: the odometry's pose stands still while its twist moves."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_WINDOW_S, _WAY_M, _STILL_M = 2.0, 0.3, 1e-3
_FEWEST = 3


def check(evidence: Evidence) -> Finding | None:
    """The pose does not change over seconds in which the twist says that the robot drives or turns."""
    rows = evidence.odometry
    if len(rows) < 20 or evidence.source != "odometry":
        return None
    step = np.diff(rows[:, 0])
    way = np.concatenate(
        [[0.0], np.cumsum(step * (np.abs(np.hypot(rows[1:, 4], rows[1:, 5])) + 0.3 * np.abs(rows[1:, 6])))]
    )
    if not np.isfinite(way[-1]):
        return None
    at = np.arange(rows[0, 0], rows[-1, 0], _WINDOW_S)
    index = np.searchsorted(rows[:, 0], at)
    told = np.diff(way[index])
    gone = np.hypot(*np.diff(rows[index, 1:3], axis=0).T) + 0.3 * np.abs(np.diff(rows[index, 3]))
    frozen = (told > _WAY_M) & (gone < _STILL_M)
    moving = told > _WAY_M
    if frozen.sum() < _FEWEST or frozen.sum() < 0.1 * moving.sum():
        return None
    return Finding(
        code="W201",
        severity="doubt",
        where=evidence.where.get("odometry", ""),
        seen=f"its pose stands still for {_WINDOW_S * frozen.sum():.0f} s in which its twist drives {told[frozen].sum():.1f} m",
        effect="the robot seems not to move",
        way_out="--motion odometry-twist drives by its twist",
    )
