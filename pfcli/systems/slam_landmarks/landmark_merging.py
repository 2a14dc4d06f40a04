"""Which landmarks of a solved map are the same, by the evidence of their joint Gaussian.

Two landmarks are the same against chance by the density of their difference at zero over that of landmarks in the map. Each
equality moves all other landmarks: where no pair is sure, pairs are tried that make others sure (joint compatibility, Neira and
Tardos 2001, with evidence in place of a gate).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_SURE, _TOGETHER = 1.0, 6.0
"""Log odds from which two landmarks are one; what an image that shows both takes from them: one detection would be of nothing."""
_SHARE, _TRIED, _POSSIBLE = 8, 25, -4.0
"""One in so many landmarks is merged before the map is solved anew; pairs that are tried where none is sure, from these odds."""
_ROUNDING_M2 = 1e-4


class Landmarks(NamedTuple):
    """mean (l, 2) and joint covariance (2 l, 2 l) of landmarks, and how many images show both of two, together (l, l)."""

    mean: NDArray[np.float64]
    cov: NDArray[np.float64]
    together: NDArray[np.int64]


def same(found: Landmarks) -> NDArray[np.int64]:
    """Labels (l,), equal for landmarks that are one: the surest of them; where nothing is sure, those that make others sure."""
    count = found.mean.shape[0]
    label = np.arange(count)
    for merged in range(max(1, count // _SHARE)):
        odds = log_odds(found)
        pairs, margin = _margins(odds)
        if pairs.shape[0] == 0:
            break
        pick = int(np.argmax(margin))
        if margin[pick] <= _SURE:
            pick = -1 if merged else _opening(found, pairs, margin)
            if pick < 0:
                break
        i, j = pairs[pick].tolist()
        found, into = _joined(found, i, j)
        label = into[label]
    return label


def log_odds(found: Landmarks) -> NDArray[np.float64]:
    """(l, l) log of how probable the difference of two is if they are one, over how probable if they are not."""
    d = found.mean[:, None] - found.mean[None]
    n = found.mean.shape[0]
    blocks = found.cov.reshape(n, 2, n, 2)
    own = blocks[np.arange(n), :, np.arange(n), :]

    def spread(a: int, b: int) -> NDArray[np.float64]:
        both = own[:, None, a, b] + own[None, :, a, b]
        return np.asarray(both - blocks[:, a, :, b] - blocks[:, b, :, a])

    xx, xy, yy = spread(0, 0) + _ROUNDING_M2, spread(0, 1), spread(1, 1) + _ROUNDING_M2
    det = np.maximum(xx * yy - xy * xy, 1e-12)
    squared = (yy * d[..., 0] ** 2 - 2.0 * xy * d[..., 0] * d[..., 1] + xx * d[..., 1] ** 2) / det
    odds = -0.5 * squared - 0.5 * np.log(det) - math.log(2.0 * math.pi) - _TOGETHER * found.together
    np.fill_diagonal(odds, -np.inf)
    area = float(np.prod(np.ptp(found.mean, axis=0) + 1.0))
    return np.asarray(odds + math.log(area / _distinct(odds, area)))


def _distinct(odds: NDArray[np.float64], area_m2: float) -> float:
    """How many different landmarks there are about: those that may be one share a count."""
    count = float(odds.shape[0])
    for _ in range(30):
        likely = 1.0 / (1.0 + np.exp(-np.clip(odds + math.log(area_m2 / count), -30.0, 30.0)))
        count = float((1.0 / (1.0 + likely.sum(axis=1))).sum())
    return count


def _margins(odds: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Pairs (k, 2) that may be one, and their odds less those of the best third landmark that either could be instead and that is
    not the other."""
    pairs = np.argwhere(np.triu(odds > _POSSIBLE, 1))
    margin, every = np.empty(pairs.shape[0]), np.arange(odds.shape[0])
    for k, (i, j) in enumerate(pairs.tolist()):
        of_i = odds[i][(odds[j] < 0.0) & (every != j)].max(initial=0.0)
        of_j = odds[j][(odds[i] < 0.0) & (every != i)].max(initial=0.0)
        margin[k] = odds[i, j] - max(float(of_i), float(of_j))
    return pairs, margin


def _opening(found: Landmarks, pairs: NDArray[np.int64], margin: NDArray[np.float64]) -> int:
    """The pair that makes two more the surest; -1 where none does."""
    best, pick = 2.0 * _SURE, -1
    for k in np.argsort(-margin, kind="stable")[:_TRIED].tolist():
        total, after = float(margin[k]), _joined(found, *pairs[k].tolist())[0]
        for _ in range(2):
            then, more = _margins(log_odds(after)) if after.mean.shape[0] > 1 else (pairs[:0], margin[:0])
            if more.size == 0 or more.max() <= 0.0:
                break
            total += float(more.max())
            after = _joined(after, *then[int(np.argmax(more))].tolist())[0]
        if total > best:
            best, pick = total, k
    return pick


def _joined(found: Landmarks, i: int, j: int) -> tuple[Landmarks, NDArray[np.int64]]:
    """The landmarks given that i and j are one, without j; and the new index of each old one."""
    h = np.zeros((2, found.cov.shape[0]))
    h[[0, 1], [2 * i, 2 * i + 1]], h[[0, 1], [2 * j, 2 * j + 1]] = 1.0, -1.0
    through = found.cov @ h.T
    gain = np.linalg.solve(h @ through + 1e-9 * np.eye(2), through.T).T
    mean = (found.mean.ravel() - gain @ (h @ found.mean.ravel())).reshape(-1, 2)
    cov, together = found.cov - gain @ through.T, found.together.copy()
    together[i] += together[j]
    together[:, i] += together[:, j]
    kept = np.delete(np.arange(mean.shape[0]), j)
    into = np.arange(mean.shape[0])
    into[j] = i
    both = np.repeat(2 * kept, 2) + np.tile([0, 1], kept.size)
    return Landmarks(mean[kept], cov[np.ix_(both, both)], together[np.ix_(kept, kept)]), np.searchsorted(kept, into)
