"""Which headings a reading fits from each of many places: all directions at once. Zhang 2014, section 2.2.2, eq. (12).

The squared differences between a reading and the expected ranges, turned by every angle, are correlations:
sum m (z - r)^2 = sum m z^2 - 2 corr(m z, r) + corr(m, r^2), one Fourier transform instead of bins x beams look-ups.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from pfcli.core.jit import kernel

_CHUNK = 4096


def squared_differences(
    expected_m: NDArray[np.float32],
    column: NDArray[np.int64],
    range_m: NDArray[np.floating],
    weight: NDArray[np.floating],
) -> NDArray[np.float32]:
    """(n, bins) weighted sum of squared differences (m^2) for a sensor that looks along each bin.

    expected_m: float32 (n, bins), expected range from each place along each direction, NaN where the map says nothing
    (such directions count nothing); column: (b,) direction of each beam in bins from where the sensor looks;
    range_m, weight: (b,).
    """
    bins = expected_m.shape[1]
    one, z, zz = (np.zeros(bins) for _ in range(3))
    np.add.at(one, column % bins, weight)
    np.add.at(z, column % bins, weight * range_m)
    np.add.at(zz, column % bins, weight * np.square(range_m))
    turned = [np.conj(fft.rfft(v)).astype(np.complex64) for v in (zz, -2.0 * z, one)]
    out = np.empty(expected_m.shape, np.float32)
    for low in range(0, expected_m.shape[0], _CHUNK):
        r = expected_m[low : low + _CHUNK]
        known = np.isfinite(r)
        r = np.where(known, r, np.float32(0.0))
        total = fft.rfft(r, axis=1) * turned[1] + fft.rfft(r * r, axis=1) * turned[2]
        if known.all():
            out[low : low + _CHUNK] = fft.irfft(total, bins, axis=1) + np.float32(zz.sum())
        else:
            total += fft.rfft(known.astype(np.float32), axis=1) * turned[0]
            out[low : low + _CHUNK] = fft.irfft(total, bins, axis=1)
    return np.maximum(out, np.float32(0.0))


@kernel
def best(log_p):
    """The most probable bin of each row of (n, bins), the first of equals. Returns (n,)."""
    out = np.empty(log_p.shape[0], np.int64)
    for i in range(log_p.shape[0]):
        k = 0
        for h in range(1, log_p.shape[1]):
            if log_p[i, h] > log_p[i, k]:
                k = h
        out[i] = k
    return out


@kernel
def strata(log_p, count, half, u):
    """Draw a heading from each of the `count` strongest modes of every row of log_p (n, bins), and one from what they leave.

    half: a mode reaches so many bins to each side of its top; u: (n, count + 1) in [0, 1). Returns (place (m,) row of each
    heading, bin (m,) fractional, log_mass (m,): of the stratum, log_drawn (m,): log_p of the bin drawn): log_mass - log_drawn
    weighs each so that all of the row is stood for.
    """
    n, bins = log_p.shape
    place, where = np.empty(n * (count + 1), np.int64), np.empty(n * (count + 1))
    log_mass, drawn = np.empty(n * (count + 1)), np.empty(n * (count + 1))
    free = np.empty(bins, np.bool_)
    m = 0
    for i in range(n):
        free[:] = True
        for j in range(count + 1):
            top = -1
            for h in range(bins):
                if free[h] and (top < 0 or log_p[i, h] > log_p[i, top]):
                    top = h
            if top < 0:
                break
            low, end = (top - half, top + half + 1) if j < count else (0, bins)
            total = 0.0
            for h in range(low, end):
                if free[h % bins]:
                    total += np.exp(log_p[i, h % bins] - log_p[i, top])
            pointer, run, chosen, share = u[i, j] * total, 0.0, top, 0.5
            for h in range(low, end):
                if not free[h % bins]:
                    continue
                p = np.exp(log_p[i, h % bins] - log_p[i, top])
                if run + p > pointer:
                    chosen, share = h % bins, (pointer - run) / p
                    break
                run += p
            for h in range(low, end):
                free[h % bins] = False
            place[m], where[m] = i, chosen + share - 0.5
            log_mass[m], drawn[m] = np.log(total) + log_p[i, top], log_p[i, chosen]
            m += 1
    return place[:m], where[:m], log_mass[:m], drawn[:m]
