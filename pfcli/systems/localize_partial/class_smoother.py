"""What is known afterwards: class probabilities given the whole log, and when the robot came in and went out."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


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
