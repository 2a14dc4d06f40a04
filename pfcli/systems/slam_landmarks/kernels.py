"""One observation of all particles: association, proposal, weight, and the landmarks' Kalman filters.

Montemerlo 2002 (FastSLAM 1.0) and 2003 (2.0). Particles are run one after the other: they share landmarks.
"""

import numpy as np

from pfcli.core.geometry import cholesky3, wrap
from pfcli.core.jit import inline_kernel, kernel
from pfcli.core.landmark_store import BLOCK, own, read
from pfcli.core.sensor.range_bearing import begin, expected, spread2, squared, update

NEW, IGNORED = -1, -2
_LOST_IN_NOISE = 25.0


@inline_kernel
def _through(hv, p, s):  # type: ignore[no-untyped-def]
    """Add hv P hv^T (2, 2) to s (3,)."""
    for a in range(3):
        for b in range(3):
            s[0] += hv[0, a] * p[a, b] * hv[0, b]
            s[1] += hv[0, a] * p[a, b] * hv[1, b]
            s[2] += hv[1, a] * p[a, b] * hv[1, b]


@inline_kernel
def _pull(x, p, hv, s, v0, v1):  # type: ignore[no-untyped-def]
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
def _associate(pose, p, z, noise, table, pool, i, columns, reject, augment, chosen):  # type: ignore[no-untyped-def]
    """Maximum likelihood association of each detection to a landmark of the particle, each landmark once."""
    out, hv, hf, s = np.empty(2), np.empty((2, 3)), np.empty((2, 2)), np.empty(3)
    for k in range(z.shape[0]):
        best, best_cost, nearest = -1, np.inf, np.inf
        for j in range(columns):
            block, row = read(table, pool, i, j)
            if block < 0:
                continue
            mark = pool[block, row]
            far = z[k, 0] + 4.0
            if abs(mark[0] - pose[0]) > far + 10.0 or abs(mark[1] - pose[1]) > far + 10.0:
                continue
            taken = False
            for m in range(k):
                taken = taken or chosen[m] == j
            expected(pose, mark[0], mark[1], out, hv, hf)
            spread2(hf, mark, noise[k], s)
            _through(hv, p, s)
            d2, log_det = squared(s, z[k, 0] - out[0], wrap(z[k, 1] - out[1]))
            nearest = min(nearest, d2)
            if not taken and d2 < reject and d2 + log_det < best_cost:
                best, best_cost = j, d2 + log_det
        if best >= 0:
            chosen[k] = best
        else:
            chosen[k] = NEW if nearest > augment else IGNORED


@kernel
def observe(pose, log_w, step, sd, z, noise, column, columns, table, pool, refs, free, top, draws, options, fixed):  # type: ignore[no-untyped-def]
    """Move, associate, propose, weigh and update. Returns the columns (n, m) that each particle took for the detections.

    pose (n, 3), log_w (n,): changed in place; step (3,), sd (3,): motion since the last observation in the old base frame;
    z (m, 2), noise (m, 2): range and bearing, variances; column (m,): known landmark of each detection, -3 unknown;
    columns (n,): landmarks of each particle, changed in place; draws (n, 3) standard normal; options: version (1, 2),
    reject and augment gates, log density of a false detection, reach (m) within which a landmark must be seen (0: any);
    fixed: the landmarks are known and not changed.
    """
    version, reject, augment, log_false, reach = options
    n, m = pose.shape[0], z.shape[0]
    used = np.full((n, m), IGNORED, np.int32)
    out, hv, hf, s = np.empty(2), np.empty((2, 3)), np.empty((2, 2)), np.empty(3)
    p, low = np.empty((3, 3)), np.zeros((3, 3))
    q, prior, x = np.empty((3, 3)), np.empty(3), np.empty(3)
    for i in range(n):
        c, sn = np.cos(pose[i, 2]), np.sin(pose[i, 2])
        prior[0] = pose[i, 0] + c * step[0] - sn * step[1]
        prior[1] = pose[i, 1] + sn * step[0] + c * step[1]
        prior[2] = wrap(pose[i, 2] + step[2])
        v0, v1 = sd[0] * sd[0], sd[1] * sd[1]
        q[:] = 0.0
        q[0, 0], q[1, 1] = c * c * v0 + sn * sn * v1, sn * sn * v0 + c * c * v1
        q[0, 1] = q[1, 0] = c * sn * (v0 - v1)
        q[2, 2] = sd[2] * sd[2]
        p[:], x[:] = q, prior
        if m > 0 and column[0] == -3:
            _associate(prior, q, z, noise, table, pool, i, columns[i], reject, augment, used[i])
        else:
            used[i] = column
            for k in range(m):
                if used[i, k] >= 0 and read(table, pool, i, used[i, k])[0] < 0:
                    used[i, k] = NEW
        if version == 2:
            for k in range(m):
                if used[i, k] < 0:
                    continue
                block, row = read(table, pool, i, used[i, k])
                mark = pool[block, row]
                expected(x, mark[0], mark[1], out, hv, hf)
                spread2(hf, mark, noise[k], s)
                e0, e1 = z[k, 0] - out[0], wrap(z[k, 1] - out[1])
                t = s.copy()
                _through(hv, p, t)
                d2, _ = squared(t, e0, e1)
                if d2 < _LOST_IN_NOISE:
                    _pull(x, p, hv, s, e0, e1)
        # the smallest eigenvalue of a covariance after many updates is rounding
        for a in range(3):
            p[a, a] += 1e-12
        log_det = cholesky3(p, low)
        for a in range(3):
            pose[i, a] = x[a]
            for b in range(a + 1):
                pose[i, a] += low[a, b] * draws[i, b]
        pose[i, 2] = wrap(pose[i, 2])
        if version == 2:
            d = pose[i] - prior
            d[2] = wrap(d[2])
            for a in range(3):
                q[a, a] += 1e-12
            log_w[i] += 0.5 * log_det + 0.5 * (draws[i] * draws[i]).sum()
            log_q = cholesky3(q, low)
            y0 = d[0] / low[0, 0]
            y1 = (d[1] - low[1, 0] * y0) / low[1, 1]
            y2 = (d[2] - low[2, 0] * y0 - low[2, 1] * y1) / low[2, 2]
            log_w[i] -= 0.5 * log_q + 0.5 * (y0 * y0 + y1 * y1 + y2 * y2)
        for k in range(m):
            j = used[i, k]
            if j == IGNORED:
                log_w[i] += log_false
                continue
            if j == NEW:
                if fixed:
                    used[i, k] = IGNORED
                    continue
                j = column[k] if column[k] >= 0 else columns[i]
                columns[i] = max(columns[i], j + 1)
                used[i, k] = j
                block = own(table, pool, refs, free, top, i, j)
                mark = pool[block, j % BLOCK]
                begin(mark, pose[i], z[k], noise[k])
                mark[5], mark[6] = 1.0, 1.0
                log_w[i] += log_false
                continue
            block, row = read(table, pool, i, j)
            expected(pose[i], pool[block, row, 0], pool[block, row, 1], out, hv, hf)
            spread2(hf, pool[block, row], noise[k], s)
            e0, e1 = z[k, 0] - out[0], wrap(z[k, 1] - out[1])
            d2, log_s = squared(s, e0, e1)
            hit = -0.5 * d2 - 0.5 * log_s - np.log(2.0 * np.pi)
            top_term = max(hit, log_false)
            log_w[i] += top_term + np.log(np.exp(hit - top_term) + np.exp(log_false - top_term))
            if fixed:
                continue
            block = own(table, pool, refs, free, top, i, j)
            mark = pool[block, row]
            mark[5] += 1.0
            mark[6] = min(mark[6] + 2.0, 20.0)
            if d2 < _LOST_IN_NOISE:
                update(mark, hf, s, e0, e1)
        if reach > 0.0 and not fixed and m > 0 and column[0] == -3:
            _drop_spurious(pose[i], used[i], table, pool, refs, free, top, i, columns[i], reach)
    return used


@kernel
def _drop_spurious(pose, used, table, pool, refs, free, top, i, columns, reach):  # type: ignore[no-untyped-def]
    """Landmarks ahead and near that were not seen lose evidence; without any they are removed."""
    for j in range(columns):
        block, row = read(table, pool, i, j)
        if block < 0:
            continue
        dx, dy = pool[block, row, 0] - pose[0], pool[block, row, 1] - pose[1]
        if dx * dx + dy * dy > reach * reach or abs(wrap(np.arctan2(dy, dx) - pose[2])) > 1.2:
            continue
        seen = False
        for k in range(used.size):
            seen = seen or used[k] == j
        if seen:
            continue
        block = own(table, pool, refs, free, top, i, j)
        pool[block, row, 6] -= 1.0
        if pool[block, row, 6] < 0.0:
            pool[block, row, 5] = 0.0
