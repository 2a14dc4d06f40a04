"""The first particles: places at random, headings from one match of the reading. Zhang 2014, section 2.2.2."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import particles
from pfcli.core.geometry import between, compose
from pfcli.core.grid import region
from pfcli.core.resample import systematic
from pfcli.core.sensor import heading_match
from pfcli.core.sensor.range_beams import Beams, Model
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.systems.localize_lookup.expected_ranges import Assets, evidence, expected_m
from pfcli.systems.localize_lookup.params import Params
from pfcli.systems.localize_lookup.reading_beams import model_of

_MOST, _CHUNK, _FEW_BEAMS = 2_000_000, 4096, 12
_HALF_MODE_RAD = 0.15
_WIDEST, _TRIES = 8.0, 3
"""Spread of hits at the widest first look by the distance between places, for posteriors are narrower than spreads; and how
many spreads are tried, from the reading's own (10 500 places: 0.1 s each)."""
_FIRST_SHARE, _STEP_SHARE, _HALVINGS, _LEAST_STEP = 0.25, 0.5, 6, 0.9
"""Effective particles, by their number, after the first look and after each narrower one, by a tenth at the least."""
_MOVES, _MOVE = 4, np.array([0.4, 0.4, 0.4 / 5.0])
"""Moves after each, by the spread of hits: end points 5 m off move as far by the heading as by the position."""


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
        return Scattered(poses, _fit(poses, beams, assets, params, params.sigma_hit_m), 0.0)
    return anywhere(beams, assets, params, rng)


def anywhere(beams: Beams, assets: Assets, params: Params, rng: np.random.Generator) -> Scattered:
    """Particles wherever the reading fits."""
    initial, grid, corrected = assets.initial, assets.grid, params.variant == "corrected"
    area = assets.start_xy.shape[0] * grid.resolution_m**2
    places = params.particles
    if corrected and params.headings == "match":
        places = int(min(max(places, area * params.start_density_per_m2), _MOST))
    drawn = particles.uniform(assets.start_xy, grid.resolution_m / 2, places, rng, initial.heading)
    if params.headings == "random":
        log_w = _fit(drawn, beams, assets, params, params.sigma_hit_m)
        return Scattered(drawn, log_w, normalize(log_w)[1] - math.log(places))
    if not corrected:
        poses, _ = _matched(drawn[:, :2], beams, params.sigma_hit_m, assets, params, rng)
        return Scattered(poses, _fit(poses, beams, assets, params, params.sigma_hit_m), 0.0)
    # a fit no narrower than the widest lets several places stand for each that fits; few beams fit widely as they are
    widest_m = math.hypot(params.sigma_hit_m, _WIDEST * math.sqrt(area / places))
    for sigma_m in np.geomspace(params.sigma_hit_m, widest_m, _TRIES):
        poses, log_over = _matched(drawn[:, :2], beams, 2.0 * sigma_m, assets, params, rng)
        weights, _ = normalize(log_over + _fit(poses, beams, assets, params, sigma_m))
        if effective_sample_size(weights) >= _FIRST_SHARE * params.particles:
            break
    poses, log_sum = _narrowed(poses, log_over, sigma_m, beams, assets, params, rng)
    log_evidence = log_sum - math.log(places * params.bins)
    return Scattered(poses, np.full(poses.shape[0], log_evidence - math.log(poses.shape[0])), log_evidence)


def _fit(
    poses: NDArray[np.float64], beams: Beams, assets: Assets, params: Params, sigma_m: float
) -> NDArray[np.float64]:
    """(n,) evidence of poses (n, 3) where hits spread by sigma_m."""
    return evidence(poses, beams, assets, model_of(params, beams, assets, sigma_m))


def _matched(
    xy: NDArray[np.float64], beams: Beams, sigma_m: float, assets: Assets, params: Params, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Robots whose first sensor stands at places (n, 2) with headings that fit, and log of prior by density of the draw, both
    per bin: the best heading as printed, or one from each of some modes and one from the rest."""
    model = model_of(params, beams, assets, sigma_m)
    to_base = between(beams.mounts[:1], np.zeros((1, 3)))
    turn = 2 * math.pi / params.bins * np.arange(params.bins)
    prior = _heading_prior(turn + assets.grid.origin.yaw_rad - beams.mounts[0, 2], assets)
    half = max(1, round(_HALF_MODE_RAD / (2 * math.pi) * params.bins))
    poses, log_over = [], []
    for low in range(0, xy.shape[0], _CHUNK):
        chunk = xy[low : low + _CHUNK]
        log_p = _all_headings(chunk, beams, model, sigma_m, assets, params) + prior
        if params.variant == "paper":
            best = heading_match.best(log_p)
            place, bin_, width = np.arange(chunk.shape[0]), best.astype(float), np.zeros(chunk.shape[0])
        else:
            u = rng.random((chunk.shape[0], params.modes + 1))
            place, bin_, mass, drawn = heading_match.strata(log_p, params.modes, half, u)
            width = mass - drawn
        yaw = bin_ * (2 * math.pi / params.bins) + assets.grid.origin.yaw_rad
        poses.append(compose(np.column_stack([chunk[place], yaw]), to_base))
        log_over.append(width + prior[np.rint(bin_).astype(np.int64) % params.bins])
    return np.concatenate(poses), np.concatenate(log_over)


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
        squares = heading_match.squared_differences(expected_m(xy, bins, assets), column, z, np.ones(z.size))
        log_p = -0.5 * model.gain / sigma_m**2 * squares.astype(np.float64)
    else:
        sensor = np.column_stack([np.repeat(xy, bins, axis=0), np.tile(yaw, xy.shape[0])])
        base = compose(sensor, between(beams.mounts[:1], np.zeros((1, 3))))
        log_p = evidence(base, beams, assets, model).reshape(xy.shape[0], bins)
    return np.asarray(log_p)


def _heading_prior(yaw: NDArray[np.float64], assets: Assets) -> NDArray[np.float64]:
    """Log of `--heading-prior` for robots that look along yaw (n,), 0 where there is none."""
    if assets.initial.heading is None:
        return np.zeros(yaw.size)
    mean, sd = assets.initial.heading
    off = np.remainder(yaw - mean + math.pi, 2 * math.pi) - math.pi
    return np.asarray(-0.5 * (off / sd) ** 2)


def _narrowed(
    poses: NDArray[np.float64],
    log_w: NDArray[np.float64],
    first_m: float,
    beams: Beams,
    assets: Assets,
    params: Params,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], float]:
    """From drawn poses (m, 3), weighed by their prior, to as many as there are particles, drawn from what the reading says
    of them; and the log of the sum of prior times evidence.

    An SMC sampler (Del Moral 2006): the spread of hits shrinks to the reading's own in steps that keep half of the effective
    particles, and after each the particles move within what it says (Metropolis).
    """

    def fit(poses: NDArray[np.float64], sigma_m: float) -> NDArray[np.float64]:
        return _fit(poses, beams, assets, params, sigma_m)

    def narrowest(base: NDArray[np.float64], high: float, n_eff: float) -> float:
        """The smallest spread whose weights leave so many effective particles."""
        low, least = params.sigma_hit_m, _LEAST_STEP * high
        if high <= low or effective_sample_size(normalize(base + fit(poses, low))[0]) >= n_eff:
            return low
        for _ in range(_HALVINGS):
            middle = math.sqrt(low * high)
            enough = effective_sample_size(normalize(base + fit(poses, middle))[0]) >= n_eff
            low, high = (low, middle) if enough else (middle, high)
        return min(high, max(least, params.sigma_hit_m))

    n, log_sum, frame = params.particles, 0.0, assets.rays.frame
    allowed = region.only(assets.grid.cells.shape, frame, assets.start_xy)
    sigma_m = narrowest(log_w, first_m, _FIRST_SHARE * n)
    log_w = log_w + fit(poses, sigma_m)
    while True:
        weights, log_mean = normalize(log_w)
        log_sum += log_mean
        poses = poses[systematic.choose(weights, rng.random(), n)]
        log_p = fit(poses, sigma_m)
        for _ in range(_MOVES):
            moved = poses + sigma_m * _MOVE * rng.standard_normal(poses.shape)
            log_moved = fit(moved, sigma_m)
            asked = _heading_prior(moved[:, 2], assets) - _heading_prior(poses[:, 2], assets)
            taken = np.log(rng.random(n)) < log_moved - log_p + asked
            taken &= region.places_at(allowed, frame, compose(moved, beams.mounts[:1])) == region.INSIDE
            poses, log_p = np.where(taken[:, None], moved, poses), np.where(taken, log_moved, log_p)
        if sigma_m <= params.sigma_hit_m:
            return poses, log_sum
        sigma_m = narrowest(-log_p, sigma_m, _STEP_SHARE * n)
        log_w = fit(poses, sigma_m) - log_p - math.log(n)
