"""What the map shows and the robot finds changes: doors that stand open now, furniture that was moved.

A beam that reads far beyond a mapped surface speaks against the place, and through an opened door scan after scan does so:
one change of the map, not many errors of the pose. Once the believed place has been trusted for some metres, what it found
gone a while ago is no evidence any more, neither between places nor for success. While much of what is in view is gone, the
map says too little for a bound in metres.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.sensor.class_conditional import Field, Scan
from pfcli.core.sensor.range_beams import ranges_from

_BEYOND_M = 1.0
"""A beam that reads so far beyond a surface is not explained by a pose that is a little off."""
_PIECE_M, _NEAR_M = 0.1, 0.3
"""Places that were found gone are kept this far apart, and stand for what is this near."""
_COUNTS_M = 4.0
"""Way for which what was found gone still speaks against the place."""
_MEAN_M, _STEP_M, _MOST = 5.0, 0.05, 0.05
"""The share of beams that read beyond is a mean over this way; a turn on the spot counts as a step; above `_MOST` the map does
not hold here (at right poses in maps that hold 0.01-0.04, on another floor 0.05-0.16)."""
_KEPT_M = 200.0
"""Way for which it is remembered."""
_LEFT = 5
"""Beams that a scan keeps, at the least."""


class MapChanges(NamedTuple):
    """found: (m, 3) place (m) in the map that was found gone, and the way driven when it was; share: of the beams that read far
    beyond a surface, over the last metres."""

    found: NDArray[np.float64]
    share: float


NOTHING = MapChanges(np.empty((0, 3)), 0.0)


def forgotten(changes: MapChanges) -> MapChanges:
    """The robot believes in another place, or was carried: what this one found gone says nothing there."""
    return changes._replace(found=NOTHING.found)


def map_holds(changes: MapChanges) -> bool:
    """Whether no more of what was in view over the last metres is gone than a place that is a little off makes of a good map."""
    return changes.share <= _MOST


def crossed(pose: NDArray[np.float64], scan: Scan, field: Field) -> NDArray[np.float64]:
    """(b, 2) where each beam of a scan from a base pose (3,) meets the first mapped surface (m, map frame); NaN unless it
    reads far beyond it. A sensor that stands in a surface crosses none."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x, y = pose[:2] + np.array([[cos, -sin], [sin, cos]]) @ scan.sensor
    angle = pose[2] + 2.0 * np.pi * scan.turn.astype(np.float64)
    met = ranges_from((x, y), angle, field.rays, field.rays.range_m)
    met = np.where((met > 0.0) & (scan.range_m > met + _BEYOND_M), met, np.nan)
    return np.column_stack([x + met * np.cos(angle), y + met * np.sin(angle)])


def counted(scan: Scan, crossings: NDArray[np.float64], changes: MapChanges, way_m: float) -> Scan:
    """The beams that are evidence: all but those through what was found gone a while ago. The scan itself where none is."""
    old = changes.found[changes.found[:, 2] <= way_m - _COUNTS_M, :2]
    stale = _near(crossings, old, _NEAR_M)
    if not stale.any() or stale.size - stale.sum() < _LEFT:
        return scan
    return Scan(np.ascontiguousarray(scan.ends[:, ~stale]), scan.range_m[~stale], scan.turn[~stale], scan.sensor)


def noted(
    changes: MapChanges, crossings: NDArray[np.float64], way_m: float, step_m: float, trusted: bool
) -> MapChanges:
    """After a scan, a step of step_m. trusted: whether what contradicts the place is taken for a change of the map."""
    gain = 1.0 - math.exp(-max(step_m, _STEP_M) / _MEAN_M)
    beyond = crossings[np.isfinite(crossings[:, 0])]
    share = changes.share + gain * (beyond.shape[0] / crossings.shape[0] - changes.share)
    if not trusted or beyond.shape[0] == 0:
        return changes._replace(share=share)
    kept = changes.found[changes.found[:, 2] > way_m - _KEPT_M]
    fresh = beyond[~_near(beyond, kept[:, :2], _PIECE_M)]
    fresh = np.unique(np.round(fresh / _PIECE_M), axis=0) * _PIECE_M
    return MapChanges(np.vstack([kept, np.column_stack([fresh, np.full(fresh.shape[0], way_m)])]), share)


def _near(points: NDArray[np.float64], places: NDArray[np.float64], within_m: float) -> NDArray[np.bool_]:
    """(b,) which of the points (b, 2), NaN or not, have one of the places (m, 2) near."""
    near, real = np.zeros(points.shape[0], np.bool_), np.flatnonzero(np.isfinite(points[:, 0]))
    if real.size and places.shape[0]:
        away = np.hypot(points[real, None, 0] - places[None, :, 0], points[real, None, 1] - places[None, :, 1])
        near[real] = away.min(axis=1) < within_m
    return near
