"""Furniture: things that stand in the map and are not drawn in it.

A robot in a furnished room sees them scan after scan. That the map lacks them is said once, when they come into view: later scans
are foretold by the earlier ones wherever the robot is, and are no evidence that it has left. So things are marked where a scan
fits the map but for beams that end before its walls, and a settled place is not held to account for them again.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.estimate import PoseEstimate
from pfcli.core.grid import rolling_grid
from pfcli.core.grid.region import crosses_wall
from pfcli.core.sensor import likelihood_field
from pfcli.core.sensor.likelihood_field import UNKNOWN
from pfcli.systems.localize_partial.incomplete_map import Assets
from pfcli.systems.localize_partial.params import Params

_FITS = 0.5
"""Share of the beams of which the map says something that must end at its surfaces, else the place is not believed."""
_THROUGH = 0.15
"""Share of them that may pass a wall: more is another place, or another floor."""
_MASS, _SD_M = 0.4, 0.3
"""A believed place has so much of all mass, and its position is known so well (m)."""
MOST = 0.4
"""Share of the beams of a scan that is taken for things: more of them are held against the place."""
_WALL_SIGMAS = 3.0
"""A beam that ends so near behind a wall has met it."""


_NEW = 0.2
"""Share of the beams of a scan that are new, beyond what a turn brings, when the robot was carried."""
_TELLS_M = 10.0
"""Way on which a robot must be believed to be outside before it is taken to have been there, and inside before it is taken to
have come in."""
_IN, _OUT = 0.9, 0.1


class Standing(NamedTuple):
    """Whether the robot may have been in the map since the start, or is known to have come in: then the map may lack things where
    it is. A robot that was outside or carried has to explain all that it sees: an outside that looks like the map has no other
    fault. way_m: on which it has been believed to be elsewhere than this says."""

    may_be_inside: bool
    way_m: float = 0.0


def at_start(kind: str) -> Standing:
    """Of a robot that was told this of its start."""
    return Standing(kind != "outside")


def after(before: Standing, in_map: float, step_m: float, carried: bool) -> Standing:
    """After an update that believes the robot to be in the map with probability in_map, and a step of step_m. carried: no scan
    of the last metres has fitted those before, or one shows another place (`is_carried`)."""
    if carried:
        return Standing(False)
    against = in_map < _OUT if before.may_be_inside else in_map > _IN
    way_m = before.way_m + step_m if against else 0.0
    return Standing(not before.may_be_inside) if way_m > _TELLS_M else Standing(before.may_be_inside, way_m)


def is_carried(explained: NDArray[np.float32], turned_rad: float, view_rad: float) -> bool:
    """Whether so much of a scan is new, beyond what a turn brings into view, that the robot may have been carried.

    explained: (b,) what the last metres say of its beams, 0 where they showed nothing there.
    """
    new = float(np.mean(explained == 0.0))
    return new > _NEW + min(1.0, abs(turned_rad) / max(view_rad, 1e-9))


class View(NamedTuple):
    """A scan: sensor (2,) and end points float32 (2, b) in the base frame (m), and the level of the field for each (b,)."""

    sensor: NDArray[np.float64]
    ends: NDArray[np.float32]
    level: NDArray[np.int32]


def things(pose: NDArray[np.float64], view: View, assets: Assets, params: Params) -> NDArray[np.bool_]:
    """(b,) which beams end at things that the map lacks, for a robot at pose (3,); none where the scan does not fit there."""
    value = likelihood_field.of_beams(pose, view.ends, assets.field, view.level)
    judged, hits = value < UNKNOWN, (value < UNKNOWN) & (value > 0.0)
    missed = judged & ~hits
    before = missed & ~_through(pose, view, missed, assets, params)
    n = int(judged.sum())
    fits = n > 0 and hits.sum() >= _FITS * n and (missed & ~before).sum() <= _THROUGH * n
    return before if fits else np.zeros(missed.size, np.bool_)


def _through(
    pose: NDArray[np.float64], view: View, missed: NDArray[np.bool_], assets: Assets, params: Params
) -> NDArray[np.bool_]:
    """(b,) which of the beams that missed pass a mapped wall."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[c, -s], [s, c]])
    sensor, ends = pose[:2] + turn @ view.sensor, pose[:2] + (turn @ view.ends).T
    out = np.zeros(missed.size, np.bool_)
    for b in np.flatnonzero(missed):
        away = ends[b] - sensor
        length = float(np.hypot(*away))
        short = max(0.0, 1.0 - _WALL_SIGMAS * params.sigma_hit_m / max(length, 1e-9))
        x, y = sensor + short * away
        out[b] = crosses_wall(assets.region.place, assets.region.frame, sensor[0], sensor[1], x, y)
    return out


def mark(
    local: rolling_grid.LocalHistory,
    reckoned: NDArray[np.float64],
    way_m: float,
    believed: PoseEstimate,
    view: View,
    assets: Assets,
    params: Params,
) -> None:
    """Remember the things of a scan at a place that is believed; reckoned: (3,) the same in the frame of the last metres."""
    if believed.mass < _MASS or believed.sd_m > _SD_M:
        return
    found = things(believed.pose, view, assets, params)
    if found.any():
        rolling_grid.mark(local, reckoned, np.ascontiguousarray(view.ends[:, found]), way_m)


def forgiven(base: NDArray[np.float32], things: NDArray[np.bool_], params: Params) -> NDArray[np.float32]:
    """What the last metres explain (2, b) for a place that has accounted for its things (b,) already."""
    out = base.copy()
    count = int(things.sum())
    if count == 0:
        return out
    share = min(1.0, MOST * things.size / count)
    nothing = np.log(1.0 - params.z_hit)
    out[1, things] = share * nothing + (1.0 - share) * out[1, things]
    return out
