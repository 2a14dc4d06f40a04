"""What is known afterwards: class probabilities given the whole log, and when the robot came in and went out."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose, wrap


class Step(NamedTuple):
    """One update: transition (7, 7), weight that went from class to class; b (7,)."""

    transition: NDArray[np.float64]
    b: NDArray[np.float64]


def backward(history: list[Step]) -> NDArray[np.float64]:
    """(updates, 7): P(class | whole log), by the forward-backward recursion over the classes (Rabiner 1989).

    gamma_t(i) = b_t(i) sum_j T(i, j) gamma_t+1(j) / b'_t+1(j), with T the share of class i that went to class j.
    """
    out = np.zeros((len(history), 7))
    out[-1] = history[-1].b
    for t in range(len(history) - 2, -1, -1):
        after = history[t + 1]
        rows = after.transition.sum(axis=1, keepdims=True)
        share = np.divide(after.transition, rows, out=np.zeros((7, 7)), where=rows > 0)
        reached = history[t].b @ share
        ratio = np.divide(out[t + 1], reached, out=np.zeros(7), where=reached > 0)
        gamma = history[t].b * (share @ ratio)
        total = gamma.sum()
        out[t] = gamma / total if total > 0 else history[t].b
    return out


class Reckoned(NamedTuple):
    """One update: pose (3,) by odometry and scans, in a frame of its own; linked: its scan follows from those before; lost: it is
    somewhere in the map, nobody knows where; found: the filter's pose (3,); sure: that is one place in the map; way (m)."""

    pose: NDArray[np.float64]
    linked: bool
    lost: bool
    found: NDArray[np.float64]
    sure: bool
    way_m: float


def poses(updates: list[Reckoned], in_map: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3): where the robot was as the whole log knows it, NaN where it never does.

    Inside they are the filter's; outside they are reckoned from the last pose inside and back from the next one, which is
    given as much weight as way has been driven from the last: what the two differ by has come with the way.
    """
    found, reckoned = np.array([u.found for u in updates]), np.array([u.pose for u in updates])
    sure = np.array([u.sure for u in updates]) & (in_map >= 0.5)
    way_m, lost = np.array([u.way_m for u in updates]), np.array([u.lost for u in updates])
    # where it gets lost it may have been carried, and what was reckoned does not reach across
    gets_lost = lost & ~np.concatenate([[False], lost[:-1]])
    piece = np.cumsum(gets_lost | ~np.array([u.linked for u in updates]))
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


def _stretches(chosen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and behind the last of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def crossings(stamps_ns: NDArray[np.int64], in_map: NDArray[np.float64]) -> list[dict[str, Any]]:
    """Entries and exits: where P(in the map) passes one half and then goes on to 0.8 or 0.2, at the time it passed."""
    found: list[dict[str, Any]] = []
    inside: bool | None = None
    passed = int(stamps_ns[0])
    for k, p in enumerate(in_map.tolist()):
        if k and (p >= 0.5) != (in_map[k - 1] >= 0.5):
            passed = int(stamps_ns[k])
        if p >= 0.8 and inside is not True:
            if inside is False:
                found.append({"kind": "entry", "t_ns": passed})
            inside = True
        elif p <= 0.2 and inside is not False:
            if inside is True:
                found.append({"kind": "exit", "t_ns": passed})
            inside = False
    return found
