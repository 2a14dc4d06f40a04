"""The least-squares problem of a whole log: what was driven and seen, its residuals and Jacobian."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
from pfcli.core.jit import kernel
from pfcli.core.sensor.range_bearing import expected
from pfcli.systems.slam_landmarks.sensor_calibration import NAMES, SENSOR


class Log(NamedTuple):
    """What was driven and seen: step (t - 1, 3) and its sd (t - 1, 4): along, across, of turning, and how far behind (m) its
    errors turn about; of each detection: at (d,) pose, of (d,) landmark, z (d, 2) range and bearing, sd (d, 2)."""

    step: NDArray[np.float64]
    step_sd: NDArray[np.float64]
    at: NDArray[np.int64]
    of: NDArray[np.int64]
    z: NDArray[np.float64]
    sd: NDArray[np.float64]


class Options(NamedTuple):
    """fixed: the landmarks are known and the first pose is not; else the first pose is given. learnt: which parts of the
    calibration (`sensor_calibration.NAMES`) are unknown."""

    fixed: bool = False
    learnt: tuple[bool, ...] = (False,) * len(NAMES)


SLAM = Options()
ALL = (True,) * len(NAMES)
"""Every part of the calibration is unknown."""


@kernel
def rows_of(track, marks, calibration, log, value, residual, robust):
    """Whitened residuals, and Jacobian blocks: of a step by its two poses and its part of the calibration (3, 8), of a
    detection by pose, landmark and its part of the calibration (2, 9)."""
    step, step_sd, at, of, z, sd = log
    n = step.shape[0]
    for k in range(n):
        a, b = track[k], track[k + 1]
        c, s = np.cos(a[2]), np.sin(a[2])
        dx, dy = b[0] - a[0], b[1] - a[1]
        way, turn, arm = 1.0 + calibration[4], 1.0 + calibration[5], step_sd[k, 3]
        ahead, aside, turned = c * dx + s * dy, -s * dx + c * dy, wrap(b[2] - a[2])
        e2 = wrap(turn * turned - step[k, 2])
        j = value[k * 24 : k * 24 + 24]
        j[:] = 0.0
        j[0], j[1], j[2], j[3], j[4], j[6] = -way * c, -way * s, way * aside, way * c, way * s, ahead
        j[8], j[9], j[10], j[11], j[12], j[14] = way * s, -way * c, -way * ahead, -way * s, way * c, aside
        # what turned about the axle behind moved the pose across
        j[10] += arm * turn
        j[13], j[15] = -arm * turn, -arm * turned
        j[18], j[21], j[23] = -turn, turn, turned
        e = (way * ahead - step[k, 0], way * aside - step[k, 1] - arm * e2, e2)
        for r in range(3):
            residual[3 * k + r] = e[r] / step_sd[k, r]
            for m in range(8):
                j[8 * r + m] /= step_sd[k, r]
    out, hv, hf = np.empty(2), np.empty((2, 3)), np.empty((2, 2))
    for k in range(at.size):
        expected(track[at[k]], marks[of[k], 0], marks[of[k], 1], out, hv, hf)
        scale = 1.0 + calibration[0] + calibration[1] * z[k, 1]
        e0 = (scale * out[0] + calibration[2] - z[k, 0]) / sd[k, 0]
        e1 = wrap(out[1] + calibration[3] - z[k, 1]) / sd[k, 1]
        w = 1.0
        if robust > 0.0:
            w = np.sqrt(1.0 / (1.0 + (e0 * e0 + e1 * e1) / (robust * robust)))
        residual[3 * n + 2 * k], residual[3 * n + 2 * k + 1] = w * e0, w * e1
        j = value[24 * n + 18 * k : 24 * n + 18 * k + 18]
        j[:] = 0.0
        for r in range(2):
            by = scale if r == 0 else 1.0
            for m in range(3):
                j[9 * r + m] = w * by * hv[r, m] / sd[k, r]
            for m in range(2):
                j[9 * r + 3 + m] = w * by * hf[r, m] / sd[k, r]
        j[5], j[6], j[7] = w * out[0] / sd[k, 0], w * out[0] * z[k, 1] / sd[k, 0], w / sd[k, 0]
        j[17] = w / sd[k, 1]


class Pattern(NamedTuple):
    """rows and columns of the Jacobian's entries that count, and which of all do; the first column of the landmarks and of the
    calibration, and how many columns there are; learnt (c,): which parts of the calibration the last columns are."""

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    counts: NDArray[np.bool_]
    marks: int
    calibration: int
    size: int
    learnt: NDArray[np.int64]


def pattern_of(log: Log, landmarks: int, options: Options) -> Pattern:
    """Where the entries of `rows_of` stand, for so many landmarks."""
    n, d = log.step.shape[0], log.at.size
    given = 0 if options.fixed else 1
    marks = 3 * (n + 1 - given)
    calibration = marks + (0 if options.fixed else 2 * landmarks)
    learnt = np.flatnonzero(options.learnt)
    column = np.full(len(NAMES), -1)
    column[learnt] = calibration + np.arange(learnt.size)
    step = 3 * (np.arange(n)[:, None] - given) + np.arange(6)
    step = np.concatenate([step, np.tile(column[SENSOR:], (n, 1))], axis=1)
    pose = 3 * (log.at[:, None] - given) + np.arange(3)
    mark = np.full((d, 2), -1) if options.fixed else marks + 2 * log.of[:, None] + np.arange(2)
    seen = np.concatenate([pose, mark, np.tile(column[:SENSOR], (d, 1))], axis=1)
    columns = np.concatenate([np.repeat(step, 3, axis=0).ravel(), np.repeat(seen, 2, axis=0).ravel()])
    rows = np.concatenate([np.repeat(np.arange(3 * n), 8), 3 * n + np.repeat(np.arange(2 * d), 9)])
    counts = columns >= 0
    return Pattern(
        rows=rows[counts],
        columns=columns[counts],
        counts=counts,
        marks=marks,
        calibration=calibration,
        size=calibration + learnt.size,
        learnt=learnt,
    )


def entries(log: Log) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Room for all Jacobian entries and residuals of `rows_of`."""
    n, d = log.step.shape[0], log.at.size
    return np.empty(24 * n + 18 * d), np.empty(3 * n + 2 * d)
