"""One update as a row of `metrics.parquet`, and the pose that it estimates."""

from typing import Any, NamedTuple

import numpy as np

from pfcli.core import estimate
from pfcli.core.estimate import PoseEstimate
from pfcli.systems.localize_partial.class_belief import Belief, in_the_map, share_in_map

_MODE_M, _MODE_RAD = 0.75, 0.5


class Info(NamedTuple):
    """One update, as a row of `metrics.parquet`; b1 .. b6: probabilities of the six states, p_ij of their transitions. b3 holds
    those too who are somewhere in the map without particles, so that n3 may be small where it is large."""

    t_ns: int
    b1: float
    b2: float
    b3: float
    b4: float
    b5: float
    b6: float
    p12: float
    p23: float
    p34: float
    p45: float
    p56: float
    p63: float
    n2: int
    n3: int
    n4: int
    n5: int
    n6: int
    n_eff: float
    log_evidence: float
    in_map: float
    mode_share: float
    sd_m: float
    way_m: float
    beams: int


def found_pose(belief: Belief) -> PoseEstimate:
    """The densest place in the map while the robot is probably inside, the mean of those outside while it is outside with a
    known pose; NaN while nobody knows."""
    b, inside = belief.b, in_the_map(belief.label)
    in_map = float(share_in_map(b))
    if inside.any() and in_map >= 0.5 and b[0] < in_map / 2:
        return estimate.densest(belief.pose[inside], belief.weight[inside], _MODE_M, _MODE_RAD)
    if in_map < 0.5 and b[4] + b[5] > b[1]:
        return estimate.whole(belief.pose[~inside], belief.weight[~inside])
    return PoseEstimate(np.full(3, np.nan), np.full((3, 3), np.nan), 0.0)


def known_inside(belief: Belief) -> bool:
    """Whether the robot is probably in the map, and particles say where."""
    return bool(share_in_map(belief.b) >= 0.5 and in_the_map(belief.label).any())


def row(belief: Belief, found: PoseEstimate, stamp_ns: int, way_m: float, beams: int) -> Info:
    """One update."""
    b, t, counts = belief.b, belief.transition, np.bincount(belief.label, minlength=7)
    rows = t.sum(axis=1)
    share = np.divide(t, rows[:, None], out=np.zeros((7, 7)), where=rows[:, None] > 0)
    shares: dict[str, Any] = {f"b{k}": float(b[k]) for k in range(1, 7)}
    shares["b3"] += float(b[0])
    shares |= {f"p{i}{j}": float(share[i, j]) for i, j in ((1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 3))}
    shares |= {f"n{k}": int(counts[k]) for k in range(2, 7)}
    in_map = float(share_in_map(b))
    return Info(
        t_ns=stamp_ns,
        **shares,
        n_eff=belief.n_eff,
        log_evidence=belief.log_evidence,
        in_map=in_map,
        mode_share=found.mass / in_map if known_inside(belief) else 0.0,
        sd_m=found.sd_m if np.isfinite(found.sd_m) else np.inf,
        way_m=way_m,
        beams=beams,
    )
