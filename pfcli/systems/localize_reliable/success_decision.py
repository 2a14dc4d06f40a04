"""Does a scan say that the robot is where a particle believes? Akai 2023, sections 3.1 and 3.2.

The decision variables are the mean residual (MAE), the share of beams that end at mapped surfaces, and the share that
would have to pass through one, which no unknown obstacle explains. The first two, after a logarithm and a logit, are
normal in both classes with one common covariance; the third is exponential. The log ratio is then linear in all three: a
residual beyond all that was learnt speaks for failure and never becomes 'no evidence' again.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.sensor import class_conditional
from pfcli.core.sensor.class_conditional import Field, Fit, Model, Scan
from pfcli.core.sensor.range_beams import Rays, ranges_from
from pfcli.errors import LogError, UsageError, reason

SUCCESS_M, SUCCESS_RAD = 0.25, np.radians(5.0)
"""Localisation is a success within these errors, everywhere in this system."""
_LEAST_M, _LEAST_SHARE = 0.01, 0.01
_TRACKED = np.array([0.05, 0.05, np.radians(1.5)])
"""What a tracker that succeeds errs by (m, m, rad)."""
_WRONG, _BEST, _AROUND = 1000, 5, 50
"""Wrong places that are tried, how many of the best are looked at closely, and at how many poses around each."""
_WIDE_M, _NEAR = 0.2, np.array([0.1, 0.1, 0.04])
_MOST_BLOCKED = 0.8
"""Share of the beams before which unknown obstacles stand in the worst simulated scan."""
_MOST = 6.0


class Classifier(NamedTuple):
    """slope (3,) and offset: log p(d | success) - log p(d | failure) = slope . d + offset; accuracy: on held-out poses;
    sensor: what it was learnt for, (beams, view in rad, range in m)."""

    slope: NDArray[np.float64]
    offset: float
    accuracy: float
    sensor: tuple[float, float, float]


def variables(fit: Fit) -> NDArray[np.float64]:
    """(n, 3) decision variables."""
    share = np.clip(fit.hits, 0.01, 0.99)
    return np.column_stack([np.log(fit.mae_m + _LEAST_M), np.log(share / (1.0 - share)), fit.through])


def log_ratio(fit: Fit, found: Classifier) -> NDArray[np.float64]:
    """(n,) log p(d | success) / p(d | failure); 0, no evidence, where no beam is on the map."""
    ratio = variables(fit) @ found.slope + found.offset
    return np.where(np.isfinite(fit.mae_m), np.clip(ratio, -_MOST, _MOST), 0.0)


class View(NamedTuple):
    """A sensor: mount (3,) in the base frame, angles (b,) of its beams (rad), usable range (m)."""

    mount: NDArray[np.float64]
    angles: NDArray[np.float64]
    range_m: float


def learn(
    free_xy: NDArray[np.float64],
    field: Field,
    model: Model,
    view: View,
    rng: np.random.Generator,
    poses: int = 1500,
) -> Classifier:
    """Simulate scans at random free places, with obstacles that the map lacks before 0 to 80 % of the beams, and compare
    them with the map from poses that are right, within what a tracker errs by, and from poses that are not: the best of
    many wrong places, where a lost filter settles, or near misses."""
    d_good, d_bad = [], []
    for k in range(poses):
        true = np.array([*free_xy[rng.integers(free_xy.shape[0])], rng.uniform(-np.pi, np.pi)])
        scan = _scan(true, field.rays, view, rng)
        if scan.range_m.size < 5:
            continue
        good = true + np.clip(rng.standard_normal(3), -2.0, 2.0) * _TRACKED
        if k % 4:
            bad = _lost(true, scan, free_xy, field, model, rng)
            if bad is None:
                continue
        else:
            away, turn = rng.uniform(SUCCESS_M, 4 * SUCCESS_M), rng.uniform(-np.pi, np.pi)
            off = np.array([away * np.cos(turn), away * np.sin(turn), rng.normal(0, 2 * SUCCESS_RAD)])
            bad = (true + off)[None]
        d = variables(class_conditional.fit(np.vstack([good, bad]), scan, field, model))
        if np.isfinite(d).all():
            d_good.append(d[0])
            d_bad.append(d[1])
    return _separate(np.array(d_good), np.array(d_bad), view)


def _lost(
    true: NDArray[np.float64],
    scan: Scan,
    free_xy: NDArray[np.float64],
    field: Field,
    model: Model,
    rng: np.random.Generator,
) -> NDArray[np.float64] | None:
    """(1, 3) where a filter that is lost settles: the best of many wrong places, looked at closely."""
    xy = free_xy[rng.integers(free_xy.shape[0], size=_WRONG)]
    bad = np.column_stack([xy, rng.uniform(-np.pi, np.pi, _WRONG)])
    for wide in (True, False):
        bad = bad[np.hypot(*(bad - true)[:, :2].T) > 4 * SUCCESS_M]
        if bad.shape[0] == 0:
            return None
        fits = class_conditional.fit(
            bad, scan, field, model._replace(sigma_m=_WIDE_M, by_rays=False) if wide else model
        )
        best = bad[np.argsort(-fits.log_likelihood, kind="stable")[:_BEST]]
        bad = np.repeat(best, _AROUND, axis=0)
        bad = bad + _NEAR * rng.standard_normal(bad.shape)
    return np.asarray(best[:1])


def _scan(true: NDArray[np.float64], rays: Rays, view: View, rng: np.random.Generator) -> Scan:
    """A scan with things in the way."""
    c, s = np.cos(true[2]), np.sin(true[2])
    x, y = true[0] + c * view.mount[0] - s * view.mount[1], true[1] + s * view.mount[0] + c * view.mount[1]
    r = ranges_from((x, y), true[2] + view.mount[2] + view.angles, rays, view.range_m)
    r = np.where(r < 0, np.inf, r)
    blocked = rng.random() * _MOST_BLOCKED
    while np.isfinite(blocked) and blocked > 0:
        width = min(blocked, rng.uniform(0.02, 0.15))
        first = int(rng.integers(r.size))
        hidden = (first + np.arange(max(1, int(width * r.size)))) % r.size
        r[hidden] = np.minimum(r[hidden], rng.uniform(0.4, 4.0))
        blocked -= width
    ok = np.isfinite(r) & (r > 0.02)
    r = r[ok] + 0.5 / np.hypot(*rays.frame[[0, 3]]) + 0.01 * rng.standard_normal(int(ok.sum()))
    gamma = view.mount[2] + view.angles[ok]
    ends = np.column_stack([view.mount[0] + r * np.cos(gamma), view.mount[1] + r * np.sin(gamma)])
    return class_conditional.scan_of(ends, view.mount[:2])


def _separate(good: NDArray[np.float64], bad: NDArray[np.float64], view: View) -> Classifier:
    """Two normal variables with a common covariance and an exponential one; a fourth of the pairs is held out."""
    sensor = (float(view.angles.size), float(np.ptp(view.angles)), float(view.range_m))
    if good.shape[0] < 20:
        return Classifier(np.zeros(3), 0.0, 0.5, sensor)
    held = np.arange(good.shape[0]) // 4 % 4 == 0  # pairs of every kind, which take turns by four
    means = good[~held].mean(axis=0), bad[~held].mean(axis=0)
    spread = (np.cov(good[~held, :2].T) + np.cov(bad[~held, :2].T)) / 2 + 1e-6 * np.eye(2)
    slope = np.linalg.solve(spread, means[0][:2] - means[1][:2])
    for k, sign in ((0, -1.0), (1, 1.0)):
        if slope[k] * sign < 0.0:  # the two go together: what the other one says already must not count backwards
            other = 1 - k
            alone = (means[0][other] - means[1][other]) / spread[other, other]
            slope[k], slope[other] = 0.0, sign * min(0.0, sign * alone)  # nor the other one by itself
    few, many = (max(_LEAST_SHARE, m[2]) for m in means)
    many = max(few, many)
    # rounded: what another machine has learnt and kept must not differ in last digits
    offset = round(float(-0.5 * (means[0] + means[1])[:2] @ slope + np.log(many / few)), 6)
    slopes = np.r_[slope, 1.0 / many - 1.0 / few].round(6)
    right = np.r_[good[held] @ slopes + offset > 0, bad[held] @ slopes + offset < 0]
    return Classifier(slopes, offset, float(right.mean()), sensor)


def save(path: Path, found: Classifier, map_digest: str) -> None:
    """Write a classifier for one map and sensor."""
    values = {"map": map_digest, "sensor": list(found.sensor), "slope": found.slope.tolist()}
    path.write_text(json.dumps(values | {"offset": found.offset, "accuracy": found.accuracy}, indent=2) + "\n")


def load(path: Path, map_digest: str, view: View) -> Classifier:
    """Read a classifier. Raises LogError for what is none, UsageError where it belongs to another map or sensor."""
    try:
        values = json.loads(path.read_text())
        slope, sensor = np.array(values["slope"], float), tuple(float(v) for v in values["sensor"])
        found = Classifier(slope, float(values["offset"]), float(values["accuracy"]), sensor)  # type: ignore[arg-type]
        if slope.shape != (3,) or len(sensor) != 3 or not np.isfinite([*slope, found.offset]).all():
            raise ValueError("wrong fields")
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: cannot be read ({reason(error)})") from None
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise LogError(f"{path}: is no classifier of `pfcli calibrate` ({reason(error)})") from None
    if values.get("map") != map_digest:
        raise UsageError(f"--classifier {path}: was learnt for another map; run `pfcli calibrate` on this one")
    here = (view.angles.size, np.ptp(view.angles), view.range_m)
    if not np.allclose(sensor, here, rtol=0.05):
        raise UsageError(
            f"--classifier {path}: was learnt for {sensor[0]:.0f} beams over {np.degrees(sensor[1]):.0f} degrees up to"
            f" {sensor[2]:g} m, the log has {here[0]} over {np.degrees(here[1]):.0f} up to {here[2]:g} m"
        )
    return found
