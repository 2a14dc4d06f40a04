"""Whether residuals look like a misalignment: three classes along the scan. After Akai's misalignment recognition.

Neighbouring beams hit the same thing, so their classes form a chain: aligned (half normal around the surface),
misaligned (exponential) or unknown (uniform). Posteriors by forward-backward.
"""

import numpy as np

from pfcli.core.jit import inline_kernel, kernel

_STAY = ((0.8, 0.0, 0.2), (0.0, 0.8, 0.2), (1 / 3, 1 / 3, 1 / 3))
_RATE_PER_M, _TOP_M = 2.0, 5.0


@inline_kernel
def _normalize(p):
    total = p[0] + p[1] + p[2]
    for i in range(3):
        p[i] /= total


@kernel
def _posteriors(density, stay):
    n = density.shape[0]
    forward, backward, out = np.empty((n, 3)), np.ones((n, 3)), np.empty((n, 3))
    for k in range(n):
        for j in range(3):
            total = 1.0 / 3 if k == 0 else 0.0
            if k > 0:
                for i in range(3):
                    total += forward[k - 1, i] * stay[i, j]
            forward[k, j] = total * density[k, j]
        _normalize(forward[k])
    for k in range(n - 2, -1, -1):
        for i in range(3):
            total = 0.0
            for j in range(3):
                total += stay[i, j] * density[k + 1, j] * backward[k + 1, j]
            backward[k, i] = total
        _normalize(backward[k])
    for k in range(n):
        for i in range(3):
            out[k, i] = forward[k, i] * backward[k, i]
        _normalize(out[k])
    return out


@kernel
def _densities(away, sigma, rate, top):
    out = np.empty((away.size, 3))
    for k in range(away.size):
        d = min(away[k], top)
        out[k, 0] = 2.0 / (sigma * np.sqrt(2.0 * np.pi)) * np.exp(-0.5 * (d / sigma) ** 2) + 1e-6
        out[k, 1] = rate * np.exp(-rate * d) + 1e-6
        out[k, 2] = 1.0 / top
    return out


def misaligned_share(away_m: np.ndarray, sigma_m: float) -> float:
    """Mean posterior of `misaligned` over the beams of a scan. away_m: (b,) distances of end points from surfaces."""
    density = _densities(away_m, 2.0 * sigma_m, _RATE_PER_M, _TOP_M)
    return float(_posteriors(density, np.array(_STAY))[:, 1].mean())
