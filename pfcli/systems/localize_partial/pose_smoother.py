"""Where the robot was as the whole log knows it, outside the map too: reckoned between the places that agree with each other."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose, wrap


class Reckoned(NamedTuple):
    """One update: pose (3,) by odometry and scans, in a frame of its own; fits: its scan fits those before; anew: those are
    forgotten here; lost: it is somewhere in the map, nobody knows where; found: the filter's pose (3,); sure: that is one place
    in the map; way (m)."""

    pose: NDArray[np.float64]
    fits: bool
    anew: bool
    lost: bool
    found: NDArray[np.float64]
    sure: bool
    way_m: float


class _Chain(NamedTuple):
    """All updates: poses found and reckoned (n, 3), way (n,), and the piece (n,) of what was reckoned, which no break parts."""

    found: NDArray[np.float64]
    reckoned: NDArray[np.float64]
    way_m: NDArray[np.float64]
    piece: NDArray[np.int64]


_OFF_M, _OFF_PER_M, _OFF_RAD, _OFF_RAD_PER_M = 0.5, 0.1, 0.2, 0.01
"""By so much, and so much more for each metre between them, two places may contradict what was reckoned."""
_LASTS_M = 10.0
"""Places that both lasted so long are both right: the robot was carried between them."""
_LOOKED_BACK = 300
"""So many stretches before one may be the last that is right."""


def poses(updates: list[Reckoned], in_map: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3): where the robot was as the whole log knows it, NaN where it never does.

    Inside they are the filter's, but for places that the ones before and after contradict; outside they are reckoned from the
    last pose inside and back from the next one, which is given as much weight as way has been driven from the last: what the
    two differ by has come with the way.
    """
    found, reckoned = np.array([u.found for u in updates]), np.array([u.pose for u in updates])
    sure = np.array([u.sure for u in updates]) & (in_map >= 0.5)
    way_m, piece = np.array([u.way_m for u in updates]), np.cumsum(_breaks(updates), dtype=np.int64)
    sure, carried = _agreeing(_Chain(found, reckoned, way_m, piece), sure)
    piece = piece + np.cumsum(carried)
    out = np.where(sure[:, None], found, np.nan)
    known = np.flatnonzero(sure)
    for start, stop in _stretches(~sure):
        before, after = known[known < start][-1:], known[known >= stop][:1]
        for k in np.unique(piece[start:stop]):
            here = start + np.flatnonzero(piece[start:stop] == k)
            ends = [a for a in (*before, *after) if piece[a] == k]
            told = [compose(found[a][None], between(reckoned[a][None], reckoned[here])) for a in ends]
            if len(told) == 2:
                share = (way_m[here] - way_m[ends[0]]) / max(1e-9, way_m[ends[1]] - way_m[ends[0]])
                off = told[1] - told[0]
                off[:, 2] = wrap(off[:, 2])
                out[here] = told[0] + share[:, None] * off
                out[here, 2] = wrap(out[here, 2])
            elif told:
                out[here] = told[0]
    return out


def _breaks(updates: list[Reckoned]) -> NDArray[np.bool_]:
    """(n,): updates to which what was reckoned before does not reach: the robot may have been carried."""
    lost = np.array([u.lost for u in updates])
    out = lost & ~np.concatenate([[False], lost[:-1]])  # where it gets lost
    for k, update in enumerate(updates):
        if update.anew:
            out[k] = True
            while k > 0 and not updates[k - 1].fits:
                k -= 1
                out[k] = True
    return np.asarray(out)


def _agreeing(chain: _Chain, sure: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Of the sure poses those that agree with each other, and where the robot was carried between two of them, both (n,).

    The stretches of sure poses that make the longest way together, no two in a row contradicting what was reckoned between.
    """
    known = np.flatnonzero(sure)
    if known.size == 0:
        return sure, np.zeros(sure.size, np.bool_)
    jumps = ~_follows(known[:-1], known[1:], chain)
    parted = (np.diff(known) > 1) | jumps
    first, last = known[np.concatenate([[True], parted])], known[np.concatenate([parted, [True]])]
    length = chain.way_m[last] - chain.way_m[first] + 1e-6
    best, before = length.copy(), np.full(first.size, -1)
    for t in range(1, first.size):
        s = np.arange(max(0, t - _LOOKED_BACK), t)
        fits = _follows(last[s], np.full(s.size, first[t]), chain)
        fits |= (length[s] >= _LASTS_M) & (length[t] >= _LASTS_M)
        if fits.any():
            chosen = s[fits][np.argmax(best[s[fits]])]
            best[t], before[t] = best[chosen] + length[t], chosen
    kept, carried, k = np.zeros(sure.size, np.bool_), np.zeros(sure.size, np.bool_), int(np.argmax(best))
    while k >= 0:
        kept[first[k] : last[k] + 1] = True
        one = int(before[k])
        if one >= 0:
            carried[first[k]] = not _follows(last[one : one + 1], first[k : k + 1], chain)[0]
        k = one
    return kept, carried


def _follows(a: NDArray[np.int64], b: NDArray[np.int64], chain: _Chain) -> NDArray[np.bool_]:
    """Whether the poses found at updates b follow from those at a by what was reckoned between (n,); so they do across breaks."""
    if a.size == 0:
        return np.zeros(0, np.bool_)
    off = between(between(chain.found[a], chain.found[b]), between(chain.reckoned[a], chain.reckoned[b]))
    way = chain.way_m[b] - chain.way_m[a]
    near = np.hypot(off[:, 0], off[:, 1]) <= _OFF_M + _OFF_PER_M * way
    return np.asarray(
        (near & (np.abs(off[:, 2]) <= _OFF_RAD + _OFF_RAD_PER_M * way)) | (chain.piece[a] != chain.piece[b])
    )


def _stretches(chosen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and behind the last of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
