"""Range and bearing of point landmarks: the measurement, its Jacobians, and the EKF of one landmark."""

import numpy as np

from pfcli.core.geometry import wrap
from pfcli.core.jit import inline_kernel


@inline_kernel
def expected(pose, lx, ly, out, hv, hf):
    """Range and bearing of (lx, ly) from a pose, into out (2,); Jacobians by the pose hv (2, 3) and the landmark hf (2, 2).

    Thrun 2005, eq. (7.14).
    """
    dx, dy = lx - pose[0], ly - pose[1]
    q = max(dx * dx + dy * dy, 1e-12)
    r = np.sqrt(q)
    out[0], out[1] = r, wrap(np.arctan2(dy, dx) - pose[2])
    hf[0, 0], hf[0, 1], hf[1, 0], hf[1, 1] = dx / r, dy / r, -dy / q, dx / q
    hv[0, 0], hv[0, 1], hv[0, 2] = -hf[0, 0], -hf[0, 1], 0.0
    hv[1, 0], hv[1, 1], hv[1, 2] = -hf[1, 0], -hf[1, 1], -1.0


@inline_kernel
def spread2(hf, mark, noise, s):
    """Innovation covariance hf P hf^T + diag(noise) into s (3,): s00, s01, s11. mark: x, y, pxx, pxy, pyy, ...; noise: (2,)."""
    a0, a1 = hf[0, 0] * mark[2] + hf[0, 1] * mark[3], hf[0, 0] * mark[3] + hf[0, 1] * mark[4]
    b0, b1 = hf[1, 0] * mark[2] + hf[1, 1] * mark[3], hf[1, 0] * mark[3] + hf[1, 1] * mark[4]
    s[0] = a0 * hf[0, 0] + a1 * hf[0, 1] + noise[0]
    s[1] = a0 * hf[1, 0] + a1 * hf[1, 1]
    s[2] = b0 * hf[1, 0] + b1 * hf[1, 1] + noise[1]


@inline_kernel
def squared(s, v0, v1):
    """(v^T S^-1 v, log det S) of an innovation."""
    det = s[0] * s[2] - s[1] * s[1]
    return (s[2] * v0 * v0 - 2.0 * s[1] * v0 * v1 + s[0] * v1 * v1) / det, np.log(det)


@inline_kernel
def update(mark, hf, s, v0, v1):
    """Kalman update of a landmark by the innovation (v0, v1) with covariance s."""
    det = s[0] * s[2] - s[1] * s[1]
    i0, i1, i2 = s[2] / det, -s[1] / det, s[0] / det
    p0, p1, p2 = mark[2], mark[3], mark[4]
    a0, a1 = p0 * hf[0, 0] + p1 * hf[0, 1], p0 * hf[1, 0] + p1 * hf[1, 1]
    b0, b1 = p1 * hf[0, 0] + p2 * hf[0, 1], p1 * hf[1, 0] + p2 * hf[1, 1]
    k00, k01 = a0 * i0 + a1 * i1, a0 * i1 + a1 * i2
    k10, k11 = b0 * i0 + b1 * i1, b0 * i1 + b1 * i2
    mark[0] += k00 * v0 + k01 * v1
    mark[1] += k10 * v0 + k11 * v1
    mark[2] = max(p0 - (k00 * a0 + k01 * a1), 1e-12)
    mark[3] = p1 - (k00 * b0 + k01 * b1)
    mark[4] = max(p2 - (k10 * b0 + k11 * b1), 1e-12)


@inline_kernel
def begin(mark, pose, z, noise):
    """A landmark first seen at z = (range, bearing) from a pose."""
    a = pose[2] + z[1]
    c, s = np.cos(a), np.sin(a)
    mark[0], mark[1] = pose[0] + z[0] * c, pose[1] + z[0] * s
    across = z[0] * z[0] * noise[1]
    mark[2] = c * c * noise[0] + s * s * across
    mark[3] = c * s * (noise[0] - across)
    mark[4] = s * s * noise[0] + c * c * across
