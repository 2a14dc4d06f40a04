"""The field in the forms in which it is asked, and what of a sighting is used."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.sensor import field_lines, known_landmarks
from pfcli.core.sensor.field_lines import RANGE_STEP_M, RANGES, Evidence, Seen, Table
from pfcli.core.sensor.known_landmarks import Detections
from pfcli.errors import UsageError
from pfcli.events import Sighting
from pfcli.formats import field_yaml
from pfcli.formats.field_yaml import Field
from pfcli.initial import Initial
from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.shared.contract import Job

BLIND_M = 0.3
"""Added to the spread (m) where poses are only being looked for: the trial poses are so far apart."""


class Assets(NamedTuple):
    """field, its table; evidence of points, and the same for poses that are roughly right; samples (k, 2) of the lines; places
    of landmarks by name and kind; area (m^2) of the table; start."""

    field: Field
    table: Table
    fine: Evidence
    rough: Evidence
    samples: NDArray[np.float64]
    places: dict[str, NDArray[np.float64]]
    area_m2: float
    initial: Initial


class View(NamedTuple):
    """What is used of a sighting: points float32 (2, b), the spread (b,) of each (m), how much each is worth, the best evidence
    the sighting could have, landmarks; seen: where points are (None where lines that are not seen do not count)."""

    points: NDArray[np.float32]
    sigma_m: NDArray[np.float64]
    worth: float
    best: float
    detections: Detections | None
    seen: Seen | None


def sigma_table(text: str) -> NDArray[np.float64]:
    """(RANGES,) spread by range from `RANGE:SIGMA,...`; never smaller farther away. Raises UsageError for other texts.

    Zhang 2011, fig. 3, falls beyond 4.7 m because the view ends there: that is no property of the sensor.
    """
    try:
        pairs = [tuple(float(v) for v in part.split(":")) for part in text.split(",")]
        at, sigma = (np.array(v) for v in zip(*pairs, strict=True))
    except ValueError:
        raise UsageError(f"sigma {text!r}: expected RANGE:SIGMA,RANGE:SIGMA,... in metres") from None
    if not (np.isfinite(at).all() and np.isfinite(sigma).all() and (sigma > 0).all() and (np.diff(at) > 0).all()):
        raise UsageError(f"sigma {text!r}: ranges must grow, and every sigma must be positive")
    middle = (np.arange(RANGES) + 0.5) * RANGE_STEP_M
    return np.asarray(np.maximum.accumulate(np.interp(middle, at, sigma)))


def load(params: Params, job: Job) -> Assets:
    """Read the field and build its tables. Raises LogError for a field file that is wrong, UsageError for a start off it."""
    field = field_yaml.read(params.field)
    hit = 1.0 if params.variant == "paper" else params.hit
    sigma = sigma_table(params.sigma)
    initial: Initial = job.initial
    low, high = field.lines.low - field_lines.MARGIN_M, field.lines.high + field_lines.MARGIN_M
    if initial.kind in ("outside", "region"):
        raise UsageError(
            f"--initial {initial.kind}: fuse-soccer starts anywhere (unknown) or at X,Y,YAW[,SDX,SDY,SDYAW]"
        )
    place = np.array(initial.pose[:2])
    if initial.kind == "pose" and not ((low < place) & (place < high)).all():
        raise UsageError(
            f"--initial: ({place[0]:g}, {place[1]:g}) is not on the field {params.field}; its centre is (0, 0)"
        )
    places: dict[str, list[tuple[float, float]]] = {}
    for mark in field.landmarks:
        for name in {field_yaml.spoken(mark.name), field_yaml.spoken(mark.kind)}:
            places.setdefault(name, []).append((mark.x_m, mark.y_m))
    return Assets(
        field=field,
        table=field_lines.build(field.lines),
        fine=field_lines.evidence_table(sigma, hit, params.reach_m),
        rough=field_lines.evidence_table(np.hypot(sigma, BLIND_M), params.hit, params.reach_m),
        samples=field_lines.samples(field.lines),
        places={name: np.array(xy) for name, xy in places.items()},
        area_m2=float(np.prod(high - low)),
        initial=initial,
    )


def view_of(sighting: Sighting, assets: Assets, params: Params) -> View:
    """The usable part of a sighting: points within range, evenly thinned; landmarks that the field has."""
    points = sighting.points_m if params.vision else np.empty((0, 2))
    points = points[np.hypot(points[:, 0], points[:, 1]) <= params.max_range_m]
    if points.shape[0] > params.points:
        points = points[np.linspace(0, points.shape[0] - 1, params.points).astype(int)]
    flat = np.ascontiguousarray(points.T, np.float32)
    bins = field_lines.range_bins(flat)
    full = params.variant == "paper" or points.shape[0] == 0
    worth = 1.0 if full else min(1.0, params.independent_points / points.shape[0])
    detections = _detections(sighting, assets, params) if params.vision else None
    best = worth * float(assets.fine.best[bins].sum())
    if detections is not None:
        best += known_landmarks.best_evidence(detections, params.hit, assets.area_m2)
    seen = field_lines.seen_from(points, params.max_range_m) if params.missed and points.size else None
    return View(
        points=flat, sigma_m=assets.fine.sigma_m[bins], worth=worth, best=best, detections=detections, seen=seen
    )


def _detections(sighting: Sighting, assets: Assets, params: Params) -> Detections | None:
    seen, places, sigma = [], [], []
    for group in sighting.landmarks:
        for name, r, bearing, given in zip(group.ids, group.range_m, group.bearing_rad, group.sigma, strict=True):
            found = assets.places.get(field_yaml.spoken(name))
            if found is None or r > params.max_range_m:
                continue
            seen.append((r * math.cos(bearing), r * math.sin(bearing)))
            places.append(found)
            row = assets.fine.sigma_m[min(int(r / RANGE_STEP_M), RANGES - 1)]
            known = math.isfinite(given[0]) and math.isfinite(given[1])
            sigma.append(max(0.02, given[0], r * given[1]) if known else row)
    if not seen:
        return None
    start = np.cumsum([0, *(len(p) for p in places)])
    return Detections(np.array(seen), np.concatenate(places), start, np.array(sigma, float))
