"""The first particles: places at random, headings from one match of the reading. Zhang 2014, section 2.2.2."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import particles
from pfcli.core.geometry import between, compose
from pfcli.core.resample import systematic
from pfcli.core.sensor import heading
from pfcli.core.sensor.range_beams import Beams, Model
from pfcli.core.weights import normalize
from pfcli.systems.localize_lookup.beams import Assets, evidence, expected_m, model_of
from pfcli.systems.localize_lookup.params import Params

_MOST, _CHUNK, _FEW_BEAMS = 2_000_000, 4096, 12
_HALF_MODE_RAD = 0.15
_ARM_M = 5.0
"""Distance at which a jitter of the heading moves an end point as far as that of the position."""


class Scattered(NamedTuple):
    """Poses (n, 3) and log weights (n,) that hold the reading already; log_evidence: log p(z) of a robot that may be
    anywhere (0 for a start that is given, and where the printed variant matches headings)."""

    pose: NDArray[np.float64]
    log_w: NDArray[np.float64]
    log_evidence: float


def scatter(beams: Beams, assets: Assets, params: Params, rng: np.random.Generator) -> Scattered:
    """Particles from nothing but a reading and what `--initial` says."""
    initial = assets.initial
    if initial.kind == "pose":
        poses = particles.gaussian(np.array(initial.pose), np.array(initial.sd), params.particles, rng)
        log_w = evidence(poses, beams, assets, model_of(params, beams, assets, params.sigma_hit_m))
        return Scattered(poses, log_w, 0.0)
    return anywhere(beams, assets, params, rng)


def anywhere(beams: Beams, assets: Assets, params: Params, rng: np.random.Generator) -> Scattered:
    """Particles wherever the reading fits."""
    initial, grid, corrected = assets.initial, assets.grid, params.variant == "corrected"
    area = assets.start_xy.shape[0] * grid.resolution_m**2
    places = params.particles
    if corrected and params.headings == "match":
        places = int(min(max(places, area * params.start_density_per_m2), _MOST))
    # places drawn at random lie so far apart: the reading fits the nearest no better than that
    sigma_m = math.hypot(params.sigma_hit_m, math.sqrt(area / places)) if corrected else params.sigma_hit_m
    drawn = particles.uniform(assets.start_xy, grid.resolution_m / 2, places, rng, initial.heading)
    if params.headings == "random":
        log_w = evidence(drawn, beams, assets, model_of(params, beams, assets, params.sigma_hit_m))
        return Scattered(drawn, log_w, normalize(log_w)[1] - math.log(places))
    poses, log_w = _matched(drawn[:, :2], beams, sigma_m, assets, params, rng)
    if not corrected:
        return Scattered(poses, log_w, 0.0)
    _, log_sum = normalize(log_w)
    poses, log_w = _narrow(poses, log_w, sigma_m, beams, assets, params, rng)
    return Scattered(poses, log_w, log_sum - math.log(places * params.bins))


def _matched(
    xy: NDArray[np.float64], beams: Beams, sigma_m: float, assets: Assets, params: Params, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Headings of the first sensor at places (n, 2), and what they weigh: the best one with its likelihood as printed,
    or some drawn from p(theta | x, y, c) with the marginal as weight."""
    model = model_of(params, beams, assets, sigma_m)
    to_base = between(beams.mounts[:1], np.zeros((1, 3)))
    prior = _heading_prior(beams, assets, params)
    half = max(1, round(_HALF_MODE_RAD / (2 * math.pi) * params.bins))
    poses, log_w = [], []
    for low in range(0, xy.shape[0], _CHUNK):
        chunk = xy[low : low + _CHUNK]
        log_p = _all_headings(chunk, beams, model, sigma_m, assets, params) + prior
        if params.variant == "paper":
            best = heading.best(log_p)
            place, bin_, width = np.arange(chunk.shape[0]), best.astype(float), np.zeros(chunk.shape[0])
        else:
            u = rng.random((chunk.shape[0], params.modes))
            place, bin_, mass, top = heading.modes(log_p, params.modes, half, u)
            width = mass - top
        yaw = bin_ * (2 * math.pi / params.bins) + assets.grid.origin.yaw_rad
        base = compose(np.column_stack([chunk[place], yaw]), to_base)
        poses.append(base)
        asked = prior[np.rint(bin_).astype(np.int64) % params.bins]
        log_w.append(width + asked + evidence(base, beams, assets, model))
    return np.concatenate(poses), np.concatenate(log_w)


def _all_headings(
    xy: NDArray[np.float64], beams: Beams, model: Model, sigma_m: float, assets: Assets, params: Params
) -> NDArray[np.float64]:
    """(n, bins) log p(c | x, y, theta) of the first sensor at each place, theta in the grid's frame."""
    bins = params.bins
    yaw = 2 * math.pi / bins * np.arange(bins) + assets.grid.origin.yaw_rad
    if beams.mounts.shape[0] == 1 and beams.turn.size >= _FEW_BEAMS:
        away = np.mod(beams.turn - beams.mounts[0, 2] / (2 * math.pi), 1.0)
        column = np.rint(away * bins).astype(np.int64) % bins
        z = np.minimum(beams.range_m, params.table_range_m) - model.wall_m / 2
        squares = heading.squared_differences(expected_m(xy, bins, assets), column, z, np.ones(z.size))
        log_p = -0.5 * model.gain / sigma_m**2 * squares.astype(np.float64)
    else:
        sensor = np.column_stack([np.repeat(xy, bins, axis=0), np.tile(yaw, xy.shape[0])])
        base = compose(sensor, between(beams.mounts[:1], np.zeros((1, 3))))
        log_p = evidence(base, beams, assets, model).reshape(xy.shape[0], bins)
    return np.asarray(log_p)


def _heading_prior(beams: Beams, assets: Assets, params: Params) -> NDArray[np.float64]:
    """(bins,) log of `--heading-prior` for the first sensor looking along each bin, 0 where there is none."""
    if assets.initial.heading is None:
        return np.zeros(params.bins)
    mean, sd = assets.initial.heading
    yaw = 2 * math.pi / params.bins * np.arange(params.bins) + assets.grid.origin.yaw_rad
    off = np.remainder(yaw - beams.mounts[0, 2] - mean + math.pi, 2 * math.pi) - math.pi
    return np.asarray(-0.5 * (off / sd) ** 2)


def _narrow(
    poses: NDArray[np.float64],
    log_w: NDArray[np.float64],
    sigma_m: float,
    beams: Beams,
    assets: Assets,
    params: Params,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Down to the particles' number and the reading's own spread, in steps of two (an SMC sampler, Del Moral 2006)."""
    while True:
        weights, _ = normalize(log_w)
        poses = poses[systematic.choose(weights, rng.random(), params.particles)]
        jitter = 0.5 * sigma_m * np.array([1.0, 1.0, 1.0 / _ARM_M])
        poses = poses + jitter * rng.standard_normal(poses.shape)
        wide = evidence(poses, beams, assets, model_of(params, beams, assets, sigma_m))
        if sigma_m <= params.sigma_hit_m:
            return poses, np.zeros(poses.shape[0])
        sigma_m = max(params.sigma_hit_m, sigma_m / 2)
        log_w = evidence(poses, beams, assets, model_of(params, beams, assets, sigma_m)) - wide
