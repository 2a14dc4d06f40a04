"""One observation of all particles: association, proposal, weight, and the landmarks' Kalman filters.

Montemerlo 2002 (FastSLAM 1.0) and 2003 (2.0). Particles are run one after the other: they share landmarks.
"""

import numpy as np

from pfcli.core.geometry import cholesky3, wrap
from pfcli.core.jit import inline_kernel, kernel, put
from pfcli.core.landmark_store import BLOCK, own, read
from pfcli.core.sensor.range_bearing import begin, expected, spread2, squared, update

NEW, IGNORED, UNKNOWN = -1, -2, -3
"""What stands for a landmark's column: it is a new one, it is none, nobody knows yet."""

_LOST_IN_NOISE = 25.0
"""A detection at this squared distance pulls nothing any more."""
_SLACK_M, _AHEAD_RAD = 14.0, 1.2
"""Landmarks so much farther than the detection are not compared with it; beyond this bearing nothing has to be seen."""


@inline_kernel
def _through(hv, p, s):
    """Add hv P hv^T (2, 2) to s (3,)."""
    for a in range(3):
        for b in range(3):
            s[0] += hv[0, a] * p[a, b] * hv[0, b]
            s[1] += hv[0, a] * p[a, b] * hv[1, b]
            s[2] += hv[1, a] * p[a, b] * hv[1, b]


@inline_kernel
def _pull(x, p, hv, s, v0, v1):
    """Kalman update of a pose (3,) and its covariance; s: without the pose's own uncertainty."""
    t = np.empty(3)
    t[0], t[1], t[2] = s[0], s[1], s[2]
    _through(hv, p, t)
    det = t[0] * t[2] - t[1] * t[1]
    i0, i1, i2 = t[2] / det, -t[1] / det, t[0] / det
    ph = np.empty((3, 2))
    for a in range(3):
        for r in range(2):
            ph[a, r] = p[a, 0] * hv[r, 0] + p[a, 1] * hv[r, 1] + p[a, 2] * hv[r, 2]
    k = np.empty((3, 2))
    for a in range(3):
        k[a, 0] = ph[a, 0] * i0 + ph[a, 1] * i1
        k[a, 1] = ph[a, 0] * i1 + ph[a, 1] * i2
        x[a] += k[a, 0] * v0 + k[a, 1] * v1
    x[2] = wrap(x[2])
    for a in range(3):
        for b in range(3):
            p[a, b] -= k[a, 0] * ph[b, 0] + k[a, 1] * ph[b, 1]


@kernel
def _associate(pose, p, seen, store, i, columns, gates, chosen):
    """Maximum likelihood association of each detection to a landmark of the particle, each landmark once. gates: squared
    distance below which a detection may be of a landmark, and beyond which it is of a new one."""
    out, hv, hf, s = np.empty(2), np.empty((2, 3)), np.empty((2, 2)), np.empty(3)
    z, noise, _ = seen
    for k in range(z.shape[0]):
        best, best_cost, nearest = -1, np.inf, np.inf
        for j in range(columns):
            block, row = read(store, i, j)
            if block < 0:
                continue
            mark = store.pool[block, row]
            far = z[k, 0] + _SLACK_M
            if abs(mark[0] - pose[0]) > far or abs(mark[1] - pose[1]) > far:
                continue
            taken = False
            for m in range(k):
                taken = taken or chosen[m] == j
            expected(pose, mark[0], mark[1], out, hv, hf)
            spread2(hf, mark, noise[k], s)
            _through(hv, p, s)
            d2, log_det = squared(s, z[k, 0] - out[0], wrap(z[k, 1] - out[1]))
            nearest = min(nearest, d2)
            if not taken and d2 < gates[0] and d2 + log_det < best_cost:
                best, best_cost = j, d2 + log_det
        if best >= 0:
            chosen[k] = best
        else:
            chosen[k] = NEW if nearest > gates[1] else IGNORED


@inline_kernel
def _predict(pose, step, sd, prior, q):
    """The pose after the step into prior (3,), and the covariance of the step in the map's frame into q (3, 3). sd (4,): along,
    across (m), of turning (rad), and how far behind the pose (m) its errors turn about."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    prior[0] = pose[0] + c * step[0] - s * step[1]
    prior[1] = pose[1] + s * step[0] + c * step[1]
    prior[2] = wrap(pose[2] + step[2])
    v0, v1 = sd[0] * sd[0], sd[1] * sd[1]
    q[:] = 0.0
    q[0, 0], q[1, 1] = c * c * v0 + s * s * v1, s * s * v0 + c * c * v1
    q[0, 1] = q[1, 0] = c * s * (v0 - v1)
    q[2, 2] = sd[2] * sd[2]
    ax, ay = -s * sd[3], c * sd[3]
    q[0, 0] += ax * ax * q[2, 2]
    q[0, 1] += ax * ay * q[2, 2]
    q[1, 1] += ay * ay * q[2, 2]
    q[1, 0] = q[0, 1]
    q[0, 2], q[1, 2] = ax * q[2, 2], ay * q[2, 2]
    q[2, 0], q[2, 1] = q[0, 2], q[1, 2]


@kernel
def _attract(x, p, seen, used, store, i):
    """Pull the proposal, mean x (3,) and covariance p (3, 3), by every detection of a known landmark (FastSLAM 2.0)."""
    out, hv, hf, s = np.empty(2), np.empty((2, 3)), np.empty((2, 2)), np.empty(3)
    z, noise, _ = seen
    for k in range(z.shape[0]):
        if used[k] < 0:
            continue
        block, row = read(store, i, used[k])
        mark = store.pool[block, row]
        expected(x, mark[0], mark[1], out, hv, hf)
        spread2(hf, mark, noise[k], s)
        e0, e1 = z[k, 0] - out[0], wrap(z[k, 1] - out[1])
        t = s.copy()
        _through(hv, p, t)
        d2, _ = squared(t, e0, e1)
        if d2 < _LOST_IN_NOISE:
            _pull(x, p, hv, s, e0, e1)


@kernel
def _draw(x, p, z, low, pose):
    """Draw a pose from N(x, p), by z (3,) standard normal; returns log det p. low (3, 3): scratch."""
    # the smallest eigenvalue of a covariance after many updates is rounding
    for a in range(3):
        p[a, a] += 1e-12
    log_det = cholesky3(p, low)
    for a in range(3):
        pose[a] = x[a]
        for b in range(a + 1):
            pose[a] += low[a, b] * z[b]
    pose[2] = wrap(pose[2])
    return log_det


@kernel
def _log_prior(pose, prior, q, low):
    """Log density (but for a constant) of the motion that led to a pose. low (3, 3): scratch."""
    d = pose - prior
    d[2] = wrap(d[2])
    for a in range(3):
        q[a, a] += 1e-12
    log_q = cholesky3(q, low)
    y0 = d[0] / low[0, 0]
    y1 = (d[1] - low[1, 0] * y0) / low[1, 1]
    y2 = (d[2] - low[2, 0] * y0 - low[2, 1] * y1) / low[2, 2]
    return 0.5 * log_q + 0.5 * (y0 * y0 + y1 * y1 + y2 * y2)


@kernel
def _learn(pose, seen, used, store, i, columns, log_false, fixed):
    """Log likelihood of the detections from a pose; landmarks are updated, new ones begun, unless they are fixed."""
    out, hv, hf, s = np.empty(2), np.empty((2, 3)), np.empty((2, 2)), np.empty(3)
    z, noise, column = seen
    total = 0.0
    for k in range(z.shape[0]):
        j = used[k]
        if j == IGNORED:
            total += log_false
            continue
        if j == NEW:
            if fixed:
                used[k] = IGNORED
                continue
            j = column[k] if column[k] >= 0 else columns[i]
            columns[i] = max(columns[i], j + 1)
            used[k] = j
            block = own(store, i, j)
            mark = store.pool[block, j % BLOCK]
            begin(mark, pose, z[k], noise[k])
            mark[5], mark[6] = 1.0, 1.0
            total += log_false
            continue
        block, row = read(store, i, j)
        expected(pose, store.pool[block, row, 0], store.pool[block, row, 1], out, hv, hf)
        spread2(hf, store.pool[block, row], noise[k], s)
        e0, e1 = z[k, 0] - out[0], wrap(z[k, 1] - out[1])
        d2, log_s = squared(s, e0, e1)
        hit = -0.5 * d2 - 0.5 * log_s - np.log(2.0 * np.pi)
        top = max(hit, log_false)
        total += top + np.log(np.exp(hit - top) + np.exp(log_false - top))
        if fixed:
            continue
        block = own(store, i, j)
        mark = store.pool[block, row]
        mark[5] += 1.0
        mark[6] = min(mark[6] + 2.0, 20.0)
        if d2 < _LOST_IN_NOISE:
            update(mark, hf, s, e0, e1)
    return total


@kernel
def observe(pose, log_w, motion, seen, columns, store, draws, options):
    """Move, associate, propose, weigh and update. Returns the columns (n, m) that each particle took for the detections.

    pose (n, 3), log_w (n,): changed in place; motion: step (3,) and sd (4,) of `_predict` since the last observation in the old
    base frame; seen: z (m, 2) range and bearing, variances (m, 2), known column (m,) of each detection or UNKNOWN; columns
    (n,): landmarks of each particle, changed in place; draws (n, 3) standard normal; options: version (1, 2), gates to reject
    and to augment, log density of a false detection, reach (m) within which a landmark must be seen (0: any), and whether
    landmarks are fixed.
    """
    version, reject, augment, log_false, reach, fixed = options
    step, sd = motion
    column = seen[2]
    n, m = pose.shape[0], column.size
    used = np.full((n, m), IGNORED, np.int32)
    p, q, low = np.empty((3, 3)), np.empty((3, 3)), np.zeros((3, 3))
    prior, x = np.empty(3), np.empty(3)
    unknown = m > 0 and column[0] == UNKNOWN
    for i in range(n):
        _predict(pose[i], step, sd, prior, q)
        put(p, q)
        put(x, prior)
        if unknown:
            _associate(prior, q, seen, store, i, columns[i], (reject, augment), used[i])
        else:
            put(used[i], column)
            for k in range(m):
                if used[i, k] >= 0 and read(store, i, used[i, k])[0] < 0:
                    used[i, k] = NEW
        if version == 2:
            _attract(x, p, seen, used[i], store, i)
        log_det = _draw(x, p, draws[i], low, pose[i])
        if version == 2:
            z = draws[i]
            log_w[i] += 0.5 * log_det + 0.5 * (z[0] * z[0] + z[1] * z[1] + z[2] * z[2])
            log_w[i] -= _log_prior(pose[i], prior, q, low)
        log_w[i] += _learn(pose[i], seen, used[i], store, i, columns, log_false, fixed)
        if unknown and reach > 0.0 and not fixed:
            _drop_spurious(pose[i], used[i], store, i, columns[i], reach)
    return used


@kernel
def _drop_spurious(pose, used, store, i, columns, reach):
    """Landmarks ahead and near that were not seen lose evidence; without any they are removed."""
    for j in range(columns):
        block, row = read(store, i, j)
        if block < 0:
            continue
        dx, dy = store.pool[block, row, 0] - pose[0], store.pool[block, row, 1] - pose[1]
        if dx * dx + dy * dy > reach * reach or abs(wrap(np.arctan2(dy, dx) - pose[2])) > _AHEAD_RAD:
            continue
        seen = False
        for k in range(used.size):
            seen = seen or used[k] == j
        if seen:
            continue
        block = own(store, i, j)
        store.pool[block, row, 6] -= 1.0
        if store.pool[block, row, 6] < 0.0:
            store.pool[block, row, 5] = 0.0
