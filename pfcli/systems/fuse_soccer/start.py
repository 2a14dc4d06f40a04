"""Particles of a robot that may be anywhere on the field: trial poses, the best refined on the lines, draws around them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import cholesky3, wrap
from pfcli.core.jit import kernel
from pfcli.core.particles import gaussian
from pfcli.core.sensor import field_lines, landmarks
from pfcli.core.weights import normalize
from pfcli.systems.fuse_soccer.assets import BLIND_M, Assets, View
from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.fuse_soccer.weigh import ONE_SIDE, Belief, Heard, weigh

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
        return Belief(pose, np.full(params.particles, -np.log(params.particles)), np.full(params.particles, ONE_SIDE))
    if params.variant == "paper":
        pose = anyhow(params.particles, heard, assets, folded=False, rng=rng)
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


@kernel
def _distinct(poses, order, most, apart_m, apart_rad):  # type: ignore[no-untyped-def]
    """The first `most` poses in this order that are apart from each other."""
    kept = np.empty(most, np.int64)
    count = 0
    for i in order:
        apart = True
        for j in range(count):
            k = kept[j]
            near = np.hypot(poses[i, 0] - poses[k, 0], poses[i, 1] - poses[k, 1]) <= apart_m
            if near and abs(wrap(poses[i, 2] - poses[k, 2])) <= apart_rad:
                apart = False
                break
        if apart:
            kept[count] = i
            count += 1
            if count == most:
                break
    return kept[:count]


@kernel
def log_density(poses, mean, precision, log_norm, weight):  # type: ignore[no-untyped-def]
    """Log of a mixture of Gaussians (k) at each pose (n, 3); log_norm (k,): of each one's peak."""
    out = np.empty(poses.shape[0])
    for i in range(poses.shape[0]):
        total = 0.0
        for k in range(mean.shape[0]):
            e0, e1, e2 = poses[i, 0] - mean[k, 0], poses[i, 1] - mean[k, 1], wrap(poses[i, 2] - mean[k, 2])
            p = precision[k]
            q = p[0, 0] * e0 * e0 + p[1, 1] * e1 * e1 + p[2, 2] * e2 * e2
            q += 2.0 * (p[0, 1] * e0 * e1 + p[0, 2] * e0 * e2 + p[1, 2] * e1 * e2)
            total += weight[k] * np.exp(log_norm[k] - 0.5 * q)
        out[i] = np.log(total + 1e-300)
    return out


@kernel
def draw_peaks(mean, cov, chosen, z):  # type: ignore[no-untyped-def]
    """One draw (n, 3) around the chosen (n,) Gaussians. z: (n, 3) standard normal."""
    out, low = np.empty(z.shape), np.zeros((3, 3))
    last = -1
    for i in range(z.shape[0]):
        k = chosen[i]
        if k != last:
            cholesky3(cov[k], low)
            last = k
        out[i, 0] = mean[k, 0] + low[0, 0] * z[i, 0]
        out[i, 1] = mean[k, 1] + low[1, 0] * z[i, 0] + low[1, 1] * z[i, 1]
        out[i, 2] = wrap(mean[k, 2] + low[2, 0] * z[i, 0] + low[2, 1] * z[i, 1] + low[2, 2] * z[i, 2])
    return out


@kernel
def precisions(cov):  # type: ignore[no-untyped-def]
    """Inverse (k, 3, 3) of each covariance, and the log (k,) of each Gaussian's peak."""
    inverse, peak, low = np.empty(cov.shape), np.empty(cov.shape[0]), np.zeros((3, 3))
    for k in range(cov.shape[0]):
        peak[k] = -0.5 * cholesky3(cov[k], low) - 1.5 * np.log(2 * np.pi)
        inverse[k] = np.linalg.inv(cov[k])
    return inverse, peak


def peaks(view: View, heard: Heard | None, assets: Assets, params: Params, rng: np.random.Generator) -> Peaks:
    """Where on the field the sighting fits: the best trial poses, refined, as Gaussians with the error's own shape."""
    trial = anyhow(params.start_particles, heard, assets, folded=assets.field.symmetric, rng=rng)
    if view.detections is not None:
        trial = np.concatenate([trial, landmarks.pair_poses(view.detections, params.start_particles)])
    rough = view.worth * field_lines.evidence(trial, view.points, assets.table, assets.rough)
    if view.detections is not None:
        blurred = view.detections._replace(sigma_m=np.hypot(view.detections.sigma_m, BLIND_M))
        rough += landmarks.evidence(trial, blurred, params.hit, assets.area_m2)
    kept = _distinct(trial, np.argsort(-rough, kind="stable"), _BEST, _APART_M, _APART_RAD)
    mean, hessian = refined(trial[kept], view, assets)
    nobody = np.zeros(kept.size)
    fit = weigh(Belief(mean, nobody, _odds(kept.size, assets)), view, heard, assets, params).log_w
    cov = np.linalg.inv(hessian) + _FLOOR
    _, log_peak = precisions(cov)
    # the mass under a peak: its height times its volume
    weight, _ = normalize(np.asarray(fit - log_peak))
    mixed = 0.9 * weight + 0.1 / weight.size
    return Peaks(mean, np.asarray(cov), np.asarray(mixed / mixed.sum()))


def refined(poses: NDArray[np.float64], view: View, assets: Assets) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses (k, 3) where lines and landmarks want them, and the Hessian (k, 3, 3) of the error there."""
    if view.points.shape[1] == 0 and view.detections is not None:
        return landmarks.refine(poses, view.detections)
    mean, hessian = field_lines.refine(poses, view.points, view.sigma_m, assets.table, assets.field.lines, view.worth)
    if view.detections is None:
        return mean, hessian
    pulled, more = landmarks.refine(mean, view.detections)
    off = pulled - mean
    off[:, 2] = wrap(off[:, 2])
    both = hessian + more
    return mean + np.linalg.solve(both, more @ off[:, :, None])[:, :, 0], both


def _odds(n: int, assets: Assets) -> NDArray[np.float64]:
    return np.zeros(n) if assets.field.symmetric else np.full(n, ONE_SIDE)


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
    if view.points.shape[1] == 0 and view.detections is None:
        pose = anyhow(n, heard, assets, folded=assets.field.symmetric, rng=rng)
        return Belief(pose, np.full(n, -np.log(n)), _odds(n, assets))
    found = peaks(view, heard, assets, params, rng)
    chosen = np.sort(rng.choice(found.weight.size, size=n, p=found.weight))
    pose = draw_peaks(found.mean, found.cov, chosen, rng.standard_normal((n, 3)))
    precision, log_peak = precisions(found.cov)
    area = float(np.prod(assets.field.lines.high - assets.field.lines.low + 2 * _OFF_FIELD_M))
    turn = np.pi if assets.field.symmetric else 2 * np.pi
    prior = -np.log(area * turn)
    log_w = prior - log_density(pose, found.mean, precision, log_peak, found.weight) - np.log(n)
    return Belief(pose, log_w, _odds(n, assets))
