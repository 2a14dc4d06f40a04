"""Particles of a robot that may be anywhere on the field: trial poses, the best refined on the lines, draws around them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate, gaussians
from pfcli.core.geometry import wrap
from pfcli.core.particles import gaussian
from pfcli.core.sensor import field_lines, known_landmarks
from pfcli.core.weights import normalize
from pfcli.systems.fuse_soccer.field_assets import BLIND_M, Assets, View
from pfcli.systems.fuse_soccer.line_proposal import refined
from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.fuse_soccer.sighting_likelihood import ONE_SIDE, Belief, Heard, sides, weigh

_BEST, _APART_M, _APART_RAD = 24, 0.4, 0.5
_FLOOR = np.diag([0.02**2, 0.02**2, 0.01**2])
_OFF_FIELD_M = 1.0
_ASTRAY = 4
"""One in so many trial poses does not believe the compass."""


class Peaks(NamedTuple):
    """Places where a sighting fits: mean (k, 3), covariance (k, 3, 3), weight (k,), sum 1."""

    mean: NDArray[np.float64]
    cov: NDArray[np.float64]
    weight: NDArray[np.float64]


def scatter(view: View, heard: Heard | None, assets: Assets, params: Params, rng: np.random.Generator) -> Belief:
    """Particles of the start, not weighed yet: around a pose, or anywhere."""
    initial = assets.initial
    if initial.kind == "pose":
        pose = gaussian(np.array(initial.pose), np.array(initial.sd), params.particles, rng)
        return Belief(
            pose, np.full(params.particles, -np.log(params.particles)), sides(params.particles, assets, params, -1.0)
        )
    if params.variant == "paper":
        pose = anyhow(params.particles, None, assets, folded=False, rng=rng)
        return Belief(pose, np.full(params.particles, -np.log(params.particles)), np.full(params.particles, ONE_SIDE))
    return anywhere(view, heard, assets, params, params.particles, rng)


def anyhow(
    n: int, heard: Heard | None, assets: Assets, *, folded: bool, rng: np.random.Generator
) -> NDArray[np.float64]:
    """(n, 3) poses anywhere on the field, looking where the compass says. folded: one of two sides will do."""
    out = np.empty((n, 3))
    low, high = assets.field.lines.low - _OFF_FIELD_M, assets.field.lines.high + _OFF_FIELD_M
    out[:, :2] = rng.uniform(low, high, (n, 2))
    if heard is None:
        out[:, 2] = rng.uniform(-np.pi / 2 if folded else -np.pi, np.pi / 2 if folded else np.pi, n)
    else:
        out[:, 2] = wrap(heard.yaw_rad + heard.sigma_rad * rng.standard_normal(n))
        # iron may bend the compass by any angle
        astray = np.arange(n) % _ASTRAY == 0
        out[astray, 2] = rng.uniform(-np.pi, np.pi, int(astray.sum()))
    return out


def peaks(view: View, heard: Heard | None, assets: Assets, params: Params, rng: np.random.Generator) -> Peaks:
    """Where on the field the sighting fits: the best trial poses, refined, as Gaussians with the error's own shape."""
    trial = anyhow(params.start_particles, heard, assets, folded=assets.field.symmetric, rng=rng)
    if view.detections is not None:
        trial = np.concatenate([trial, known_landmarks.pair_poses(view.detections, params.start_particles)])
    rough = view.worth * field_lines.evidence(trial, view.points, assets.table, assets.rough)
    if view.detections is not None:
        blurred = view.detections._replace(sigma_m=np.hypot(view.detections.sigma_m, BLIND_M))
        rough += known_landmarks.evidence(trial, blurred, params.hit, assets.area_m2)
    kept = estimate.distinct(trial, np.argsort(-rough, kind="stable"), _BEST, _APART_M, _APART_RAD)
    mean, hessian = refined(trial[kept], view, assets)
    nobody = np.zeros(kept.size)
    fit = weigh(Belief(mean, nobody, sides(kept.size, assets, params)), view, heard, assets, params).log_w
    cov = np.linalg.inv(hessian) + _FLOOR
    _, log_peak = gaussians.precisions(cov)
    # the mass under a peak: its height times its volume
    weight, _ = normalize(np.asarray(fit - log_peak))
    mixed = 0.9 * weight + 0.1 / weight.size
    return Peaks(mean, np.asarray(cov), np.asarray(mixed / mixed.sum()))


def anywhere(
    view: View,
    heard: Heard | None,
    assets: Assets,
    params: Params,
    n: int,
    rng: np.random.Generator,
) -> Belief:
    """n particles of a robot that may be anywhere, drawn where the sighting fits; their weights undo the choice: prior
    over proposal. Not weighed by the sighting yet."""
    found = peaks(view, heard, assets, params, rng)
    chosen = np.sort(rng.choice(found.weight.size, size=n, p=found.weight))
    pose = gaussians.draw(found.mean, found.cov, chosen, rng.standard_normal((n, 3)))
    precision, log_peak = gaussians.precisions(found.cov)
    area = float(np.prod(assets.field.lines.high - assets.field.lines.low + 2 * _OFF_FIELD_M))
    turn = np.pi if assets.field.symmetric else 2 * np.pi
    prior = -np.log(area * turn)
    log_w = prior - gaussians.log_density(pose, found.mean, precision, log_peak, found.weight) - np.log(n)
    return Belief(pose, log_w, sides(n, assets, params))
