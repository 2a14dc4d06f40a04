"""W304: scans turn the other way round than the robot does."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.checks.turns import turn_factor
from pfcli.findings import Finding


def check(evidence: Evidence) -> Finding | None:
    """Scans and motion turn in opposite directions: a laser that hangs upside down, or a heading with the wrong sign."""
    if turn_factor(evidence) != -1.0:
        return None
    straight = _straightness(evidence)
    heading = straight is not None and straight < 0.7
    return Finding(
        code="W204" if heading else "W304",
        severity="doubt",
        where=evidence.where.get("odometry" if heading else "scan", ""),
        seen="scans turn to the left where the motion turns to the right"
        + ("; the way does not follow its own heading either" if heading else ""),
        effect="the map is mirrored and folds at every turn",
        way_out="the heading's sign is wrong: yaw grows counter-clockwise"
        if heading
        else "an upside-down laser: give its roll in /tf_static; wheels that are swapped: --wheel-joints LEFT,RIGHT;"
        " beams counted clockwise: field 'angle_increment' is negative",
    )


def _straightness(evidence: Evidence) -> float | None:
    """How well the motion goes along its own heading (1: always); None where it hardly moves."""
    rows = evidence.motion
    at = np.arange(rows[0, 0], rows[-1, 0], 0.2)
    x, y, yaw = (np.interp(at, rows[:, 0], rows[:, k]) for k in (1, 2, 3))
    step = np.diff(x) + 1j * np.diff(y)
    moved = np.abs(step) > 0.02
    if moved.sum() < 20:
        return None
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    body = np.angle(step[moved]) - middle[moved]
    return float(np.abs(np.exp(1j * body).mean()))
