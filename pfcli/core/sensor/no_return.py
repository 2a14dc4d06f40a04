"""Readings that mean 'nothing came back', told from a histogram: a scanner repeats a value, or a band of values, at its top."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

GAP_M = 0.2
"""Values of one band lie no farther apart."""
_LEAST, _LEAST_SHARE = 3, 1e-5
_TIMES, _TIMES_STATED = 5.0, 2.0
"""A band holds so many times what any stretch as long holds below it; less is asked where the limit that is stated lies there."""
_BELOW = 0.5
"""So far down, as a share of the band's range, readings are compared with it."""


class Band(NamedTuple):
    """The band: its first and last value (m), how many readings, and how many lie above it."""

    first_m: float
    last_m: float
    readings: int
    above: int


def band(ranges_m: NDArray[np.floating], stated_m: float = np.inf) -> Band | None:
    """The top band of readings, any shape, in m; None where the top is thin.

    stated_m: the largest range that the scanner states. Lone readings above the band are no part of it.
    """
    values = np.asarray(ranges_m, np.float32).ravel()
    values = values[np.isfinite(values) & (values > 0)]
    if values.size == 0:
        return None
    found, counts = np.unique(values, return_counts=True)
    least = max(_LEAST, round(_LEAST_SHARE * values.size))
    for end in _ends(found, counts, least):
        begin = _begin(found, counts, end)
        if begin == 0 and found[end] < stated_m:
            continue  # a scanner that reads one value only, and that below its limit: a wall all around says the same
        held = int(counts[begin : end + 1].sum())
        most = _most_below(found, counts, begin, float(found[end] - found[begin]))
        times = _TIMES_STATED if found[begin] >= 0.98 * stated_m else _TIMES
        above = int(counts[end + 1 :].sum())
        if held >= least and held > times * most and above <= held / 10:
            return Band(float(found[begin]), float(found[end]), held, above)
    return None


def usable_m(ranges_m: NDArray[np.floating], stated_m: float = np.inf) -> float:
    """The largest usable range: just below the band, the largest reading where there is none, infinity without readings."""
    values = np.asarray(ranges_m, np.float32).ravel()
    values = values[np.isfinite(values)]
    if values.size == 0:
        return float(np.inf)
    top = band(values, stated_m)
    return below(top.first_m) if top is not None else float(values.max())


def below(value_m: float) -> float:
    """A limit that a reading of this value reaches, and none of what a scanner can tell from it does."""
    return float(np.float32(value_m) - np.float32(1e-3))


def _ends(found: NDArray[np.float32], counts: NDArray[np.int64], least: int) -> list[int]:
    """Indices where a band may end, from the top: values of many readings; so few that lie above are outliers."""
    heavy = np.flatnonzero(counts >= least)[::-1]
    return [int(k) for k in heavy[:_MOST]]


_MOST = 8


def _begin(found: NDArray[np.float32], counts: NDArray[np.int64], end: int) -> int:
    """Where the band that ends at an index begins: the lowest value that holds far more than the density below, without a
    gap."""
    low = np.searchsorted(found, _BELOW * found[end])
    thin = np.median(counts[low:end]) if end > low else 0.0
    heaviest = int(counts[end])
    begin = end
    for k in range(end - 1, -1, -1):
        if found[begin] - found[k] > GAP_M or found[end] - found[k] > 5 * GAP_M:
            break
        if counts[k] > _TIMES * thin and counts[k] * 100 > heaviest:
            begin = k
            heaviest = max(heaviest, int(counts[k]))
    return begin


def _most_below(found: NDArray[np.float32], counts: NDArray[np.int64], begin: int, width_m: float) -> int:
    """The most readings in any stretch below the band that is as long as the band, and at least a gap long."""
    low = int(np.searchsorted(found, _BELOW * found[begin]))
    if begin <= low:
        return 0
    total = np.concatenate([[0], np.cumsum(counts[low:begin])])
    ends = np.searchsorted(found[low:begin], found[low:begin] + max(width_m, GAP_M), "right")
    return int((total[ends] - total[:-1]).max())
