"""Landmarks of particles whose whole tracks are known: Kalman filters that have forgotten nothing."""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
from pfcli.core.jit import kernel
from pfcli.core.landmark_store import FIELDS
from pfcli.core.sensor.range_bearing import expected
from pfcli.systems.slam_landmarks.landmark_problem import Log
from pfcli.systems.slam_landmarks.sensor_calibration import corrected


@kernel
def _given(tracks, marks, at, of, z, sd, out):
    e, hv, hf = np.empty(2), np.empty((2, 3)), np.empty((2, 2))
    info = np.empty((marks.shape[0], 6))
    for i in range(tracks.shape[0]):
        info[:] = 0.0
        for k in range(at.size):
            j = of[k]
            expected(tracks[i, at[k]], marks[j, 0], marks[j, 1], e, hv, hf)
            v = (z[k, 0] - e[0], wrap(z[k, 1] - e[1]))
            w = 1.0 / (1.0 + ((v[0] / sd[k, 0]) ** 2 + (v[1] / sd[k, 1]) ** 2) / 25.0)
            for r in range(2):
                iv = w / (sd[k, r] * sd[k, r])
                info[j, 0] += iv * hf[r, 0] * hf[r, 0]
                info[j, 1] += iv * hf[r, 0] * hf[r, 1]
                info[j, 2] += iv * hf[r, 1] * hf[r, 1]
                info[j, 3] += iv * hf[r, 0] * v[r]
                info[j, 4] += iv * hf[r, 1] * v[r]
            info[j, 5] += 1.0
        for j in range(marks.shape[0]):
            det = info[j, 0] * info[j, 2] - info[j, 1] * info[j, 1]
            out[i, j] = 0.0
            if info[j, 5] == 0.0 or det <= 0.0:
                continue
            p0, p1, p2 = info[j, 2] / det, -info[j, 1] / det, info[j, 0] / det
            out[i, j, 0] = marks[j, 0] + p0 * info[j, 3] + p1 * info[j, 4]
            out[i, j, 1] = marks[j, 1] + p1 * info[j, 3] + p2 * info[j, 4]
            out[i, j, 2], out[i, j, 3], out[i, j, 4] = p0, p1, p2
            out[i, j, 5], out[i, j, 6] = info[j, 5], 20.0


def given_tracks(
    tracks: NDArray[np.float64], marks: NDArray[np.float64], calibration: NDArray[np.float64], log: Log
) -> NDArray[np.float64]:
    """Landmarks (n, l, FIELDS) of particles whose whole tracks (n, t, 3) are known: mean and covariance from all their
    detections. marks (l, 2): where they are about."""
    out = np.empty((tracks.shape[0], marks.shape[0], FIELDS))
    z, _ = corrected(log.z, log.step, calibration)
    _given(tracks, marks, log.at, log.of, z, log.sd, out)
    return out
