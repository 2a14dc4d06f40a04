"""What a sighting says of each particle, which stands for two poses: its own, and half a turn about the field's centre away.

The lines of a field look the same from both. So `odds` (n,), the log odds that the truth is the turned pose, is kept beside
each particle and updated exactly (Rao-Blackwell): without a compass no side is ever lost, and with one the weaker side is
found again by its own evidence.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
from pfcli.core.jit import kernel
from pfcli.core.sensor import compass, field_lines, known_landmarks
from pfcli.systems.fuse_soccer.field_assets import Assets, View
from pfcli.systems.fuse_soccer.params import Params

ONE_SIDE = -np.inf
"""Odds of particles that stand for one pose only."""

_SURE = 8.0
_FORGET_CARRIED = 0.2
_CHANGE = 0.6
"""The other side has to be so probable before it is shown: sides that are equally likely do not alternate."""


class Heard(NamedTuple):
    """A reading of the compass in the field's frame (rad), the spread that it is weighed with, and its share of weight."""

    yaw_rad: float
    sigma_rad: float
    worth: float


class Belief(NamedTuple):
    """pose (n, 3), log weight (n,), odds (n,)."""

    pose: NDArray[np.float64]
    log_w: NDArray[np.float64]
    odds: NDArray[np.float64]


def sides(n: int, assets: Assets, params: Params, sign: float = 0.0) -> NDArray[np.float64]:
    """Odds of n new particles: even (sign 0) or sure of their own side (-1); one side only where the field has no other."""
    return np.full(n, sign * _SURE if assets.field.symmetric and params.variant == "corrected" else ONE_SIDE)


def turned(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each pose (n, 3) half a turn about the centre of the field."""
    out = -poses
    out[:, 2] = wrap(poses[:, 2] + np.pi)
    return out


@kernel
def _two_sides(own, other, odds, log_w):
    """Weigh by the mean over both sides, and move the odds by their difference."""
    for i in range(own.size):
        if odds[i] == -np.inf:
            log_w[i] += own[i]
            continue
        top = max(own[i], other[i])
        share = 1.0 / (1.0 + np.exp(-odds[i]))
        log_w[i] += top + np.log((1.0 - share) * np.exp(own[i] - top) + share * np.exp(other[i] - top))
        odds[i] = min(max(odds[i] + other[i] - own[i], -_SURE), _SURE)


@kernel
def _forget(odds, share):
    for i in range(odds.size):
        if odds[i] != -np.inf:
            p = 1.0 / (1.0 + np.exp(-odds[i]))
            p += share * (0.5 - p)
            odds[i] = np.log(p / (1.0 - p))


@kernel
def _gather_sides(pose, odds, yaw):
    """Let every particle show the side that looks about the same way as `yaw`."""
    for i in range(odds.size):
        if odds[i] != -np.inf and abs(wrap(pose[i, 2] - yaw)) > np.pi / 2:
            pose[i, 0], pose[i, 1], pose[i, 2] = -pose[i, 0], -pose[i, 1], wrap(pose[i, 2] + np.pi)
            odds[i] = -odds[i]


@kernel
def share_turned(weights, odds):
    """Probability that the truth is on the other side of what the particles show."""
    total = 0.0
    for i in range(odds.size):
        total += weights[i] / (1.0 + np.exp(-odds[i]))
    return total


def of_lines(pose: NDArray[np.float64], view: View, assets: Assets, params: Params) -> NDArray[np.float64]:
    """Evidence (n,) of the line points, each worth its share."""
    if view.points.shape[1] == 0:
        return np.zeros(pose.shape[0])
    if params.confidence == "exact":
        hit = 1.0 if params.variant == "paper" else params.hit
        lines = assets.field.lines
        found = field_lines.evidence_exact(pose, view.points, lines, view.sigma_m, hit, params.reach_m)
    else:
        found = field_lines.evidence(pose, view.points, assets.table, assets.fine)
    return view.worth * found


def of_missed(pose: NDArray[np.float64], view: View, assets: Assets, params: Params) -> NDArray[np.float64]:
    """Evidence (n,) of the lines that ought to be seen; 0 where these do not count."""
    if view.seen is None:
        return np.zeros(pose.shape[0])
    return view.worth * field_lines.evidence_of_missed(pose, assets.samples, view.seen, params.miss)


def weigh(belief: Belief, view: View, heard: Heard | None, assets: Assets, params: Params) -> Belief:
    """The belief after a sighting: lines, landmarks, compass."""
    pose, odds = belief.pose, belief.odds.copy()
    log_w = belief.log_w + of_lines(pose, view, assets, params)
    folded = odds.size > 0 and odds[0] != ONE_SIDE
    if view.detections is not None:
        own = known_landmarks.evidence(pose, view.detections, params.hit, assets.area_m2)
        other = known_landmarks.evidence(turned(pose), view.detections, params.hit, assets.area_m2) if folded else own
        _two_sides(own, other, odds, log_w)
    if heard is not None:
        model = compass.Compass(heard.sigma_rad, params.compass_outliers)
        own = heard.worth * compass.fit(pose[:, 2], heard.yaw_rad, model)
        other = heard.worth * compass.fit(pose[:, 2] + np.pi, heard.yaw_rad, model) if folded else own
        _two_sides(own, other, odds, log_w)
    return Belief(pose, log_w, odds)


def choose_side(
    belief: Belief, yaw_rad: float, weights: NDArray[np.float64], forgotten: float, carried: bool
) -> tuple[Belief, float]:
    """The belief with all particles shown on one side, and the probability of the other one.

    yaw_rad: where the side that was shown last looks; it is kept until the other one is clearly more probable. forgotten: how
    much of what was known of the side fades, for robots are carried; more if this one seems to have been.
    """
    if belief.odds.size == 0 or belief.odds[0] == ONE_SIDE:
        return belief, 0.0
    pose, odds = belief.pose.copy(), belief.odds.copy()
    _forget(odds, min(1.0, forgotten + _FORGET_CARRIED * carried))
    _gather_sides(pose, odds, yaw_rad)
    share = float(share_turned(weights, odds))
    if share > _CHANGE:
        return Belief(turned(pose), belief.log_w, -odds), 1.0 - share
    return Belief(pose, belief.log_w, odds), share
