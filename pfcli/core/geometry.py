"""Poses in the plane as (x, y, yaw) rows, composed and related by kernels."""

import numpy as np

from pfcli.core.jit import inline_kernel, kernel, put


@inline_kernel
def wrap(angle):
    """The angle (rad, scalar) in -pi .. pi."""
    return angle - 2 * np.pi * np.floor((angle + np.pi) / (2 * np.pi))


@kernel
def cholesky3(a, low):
    """Lower Cholesky factor of a symmetric positive definite 3 x 3 matrix, written into `low`; returns log det a."""
    low[0, 0] = np.sqrt(a[0, 0])
    low[1, 0], low[2, 0] = a[1, 0] / low[0, 0], a[2, 0] / low[0, 0]
    low[1, 1] = np.sqrt(a[1, 1] - low[1, 0] * low[1, 0])
    low[2, 1] = (a[2, 1] - low[2, 0] * low[1, 0]) / low[1, 1]
    low[2, 2] = np.sqrt(a[2, 2] - low[2, 0] * low[2, 0] - low[2, 1] * low[2, 1])
    return 2.0 * (np.log(low[0, 0]) + np.log(low[1, 1]) + np.log(low[2, 2]))


@kernel
def solve3(low, b, out):
    """Solve low low^T out = b: low (3, 3) from `cholesky3`, b (3,), out (3,) is written."""
    y0 = b[0] / low[0, 0]
    y1 = (b[1] - low[1, 0] * y0) / low[1, 1]
    out[2] = (b[2] - low[2, 0] * y0 - low[2, 1] * y1) / (low[2, 2] * low[2, 2])
    out[1] = (y1 - low[2, 1] * out[2]) / low[1, 1]
    out[0] = (y0 - low[1, 0] * out[1] - low[2, 0] * out[2]) / low[0, 0]


@kernel
def compose(poses, step):
    """Each pose (n, 3) followed by the step(s) (m, 3) in its frame; n or m may be 1."""
    n = max(poses.shape[0], step.shape[0])
    out = np.empty((n, 3))
    for k in range(n):
        p, s = poses[min(k, poses.shape[0] - 1)], step[min(k, step.shape[0] - 1)]
        cos, sin = np.cos(p[2]), np.sin(p[2])
        out[k, 0] = p[0] + cos * s[0] - sin * s[1]
        out[k, 1] = p[1] + sin * s[0] + cos * s[1]
        out[k, 2] = wrap(p[2] + s[2])
    return out


@kernel
def between(a, b):
    """Each pose of b (m, 3) seen from the pose of a (n, 3); n or m may be 1."""
    n = max(a.shape[0], b.shape[0])
    out = np.empty((n, 3))
    for k in range(n):
        p, q = a[min(k, a.shape[0] - 1)], b[min(k, b.shape[0] - 1)]
        cos, sin = np.cos(p[2]), np.sin(p[2])
        dx, dy = q[0] - p[0], q[1] - p[1]
        out[k, 0] = cos * dx + sin * dy
        out[k, 1] = -sin * dx + cos * dy
        out[k, 2] = wrap(q[2] - p[2])
    return out


@kernel
def spread_residual(start, end, odometry, reached):
    """Poses of the scans between two updates: odometry, with what the update corrected spread along the way.

    start, end: (3,) poses at the two updates; odometry: (k, 3), from the first update's scan up to the scan before
    the next update; reached: (3,) odometry at the next update. Returns (k, 3).
    """
    k = odometry.shape[0]
    moved = between(odometry[:1], odometry)
    whole = between(odometry[:1], reached.reshape(1, 3))
    predicted = compose(start.reshape(1, 3), whole)
    residual = between(predicted, end.reshape(1, 3))
    along = np.zeros(k + 1)
    for j in range(1, k + 1):
        a, b = odometry[j - 1], odometry[j] if j < k else reached
        along[j] = along[j - 1] + np.hypot(b[0] - a[0], b[1] - a[1]) + 0.3 * abs(wrap(b[2] - a[2]))
    out, part = compose(start.reshape(1, 3), moved), np.empty((1, 3))
    for j in range(k):
        share = along[j] / along[k] if along[k] > 0 else j / k
        for c in range(3):
            part[0, c] = residual[0, c] * share
        put(out[j], compose(out[j : j + 1], part)[0])
    return out
