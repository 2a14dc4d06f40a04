"""A track against relations between its poses (Kuemmerle et al. 2009)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.evaluation.se2 import between
from pfcli.errors import LogError

_Array = NDArray[np.float64]

FAR_SCANS = 100
"""Relations of scans at least so far apart are re-visits; they judge a SLAM, the short ones are met by odometry."""


class Relation(NamedTuple):
    """The pose of stamp `second` seen from the pose of stamp `first` (m, m, rad)."""

    first: str
    second: str
    x_m: float
    y_m: float
    yaw_rad: float


class RelationErrors(NamedTuple):
    """Per relation: translation (m), |rotation| (rad), and how many scans lie between its two."""

    translation_m: _Array
    rotation_rad: _Array
    scans_apart: NDArray[np.int64]
    missing: int


def relation_errors(relations: list[Relation], stamps: list[str], poses: _Array) -> RelationErrors:
    """inv(rel) o (inv(x_i) o x_j); stamps: text of each pose, the relations' keys. Exact text first, then within 1 ms."""
    exact = {text: k for k, text in enumerate(stamps)}
    values = np.array([_number(t) for t in stamps])
    order = np.argsort(values, kind="stable")
    pairs, wanted = [], []
    for r in relations:
        i, j = (_find(key, exact, values, order) for key in (r.first, r.second))
        if i is not None and j is not None:
            pairs.append((i, j))
            wanted.append((r.x_m, r.y_m, r.yaw_rad))
    if not pairs:
        raise LogError(
            f"no relation fits: they run from {relations[0].first}, the track's stamps from {stamps[0]} to {stamps[-1]};"
            " give the log with --stamps"
        )
    index = np.array(pairs)
    error = between(np.array(wanted), between(poses[index[:, 0]], poses[index[:, 1]]))
    return RelationErrors(
        np.hypot(error[:, 0], error[:, 1]),
        np.abs(error[:, 2]),
        np.abs(index[:, 0] - index[:, 1]),
        len(relations) - len(pairs),
    )


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _find(key: str, exact: dict[str, int], values: _Array, order: NDArray[np.int64]) -> int | None:
    if key in exact:
        return exact[key]
    at = int(np.searchsorted(values[order], float(key)))
    near = [int(order[k]) for k in (at - 1, at) if 0 <= k < order.size]
    best = min(near, key=lambda k: abs(values[k] - float(key)))
    return best if abs(values[best] - float(key)) <= 1.5e-3 else None
