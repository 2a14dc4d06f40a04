"""How far end points lie from the surfaces that they belong to, learnt from the log: spread of an end point, and side of a cell.

A spread that is too small for the scanner and the place makes right scans look wrong: they are not drawn, and the robot is
lost. One that is too large blurs what a fine scanner tells.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid import scan_match, tiles
from pfcli.core.grid.scan_odometry import ScanOdometry, ends_of
from pfcli.core.grid.scan_points import beams_of
from pfcli.events import Sweep
from pfcli.systems.shared.motion_gate import step_since
from pfcli.systems.slam_gdr import matching
from pfcli.systems.slam_gdr.params import Params

_USUAL_M, _USUAL_CELL_M = 0.03, 0.05
"""Of an indoor scanner: less is not asked for."""
_WIDE_M, _WIDE_CELL_M = 0.1, 0.1
"""Matched with while learning, so that nothing is left out that may belong to a surface; the second is the coarse cell too."""
_MOST_M = 0.15
_SHARE, _FACTOR = 0.9, 1.5
"""The spread is so many times the distance within which this share of the end points lies."""
_COARSE_FROM_M = 0.045
"""From this spread on coarse cells are enough."""
_BLOCK, _BLOCKS = 12, 32
"""Successive updates that are matched with each other, and how many such blocks are kept, spread over the log."""
_ENOUGH = 200


class Learnt(NamedTuple):
    """params: without a value left open; reason: of what was learnt, for run.json."""

    params: Params
    reason: dict[str, Any]


def learnt(params: Params, sweeps: Iterable[Sweep]) -> Learnt:
    """The parameters with `sigma_hit_m` and `resolution_m` filled in where they are 0."""
    wide = replace(
        params, sigma_hit_m=_WIDE_M, resolution_m=_WIDE_CELL_M, match_width_m=max(params.match_width_m, 3 * _WIDE_M)
    )
    off = [_distances(block, wide) for block in _blocks(sweeps, wide)] if not params.sigma_hit_m else []
    distances = np.concatenate(off) if off else np.zeros(0)
    spread_m, reason = params.sigma_hit_m, "as given"
    if not spread_m:
        spread_m, reason = _USUAL_M, "too few end points to tell: as usual indoors"
        if distances.size >= _ENOUGH:
            within = float(np.quantile(distances, _SHARE))
            spread_m = round(float(np.clip(_FACTOR * within, _USUAL_M, _MOST_M)), 2)
            reason = f"{_SHARE:.0%} of {distances.size} end points lie within {within:.3f} m of a surface"
    cell_m = params.resolution_m or (_WIDE_CELL_M if spread_m >= _COARSE_FROM_M else _USUAL_CELL_M)
    told = {"sigma_hit_m": spread_m, "resolution_m": cell_m, "sigma_hit_reason": reason}
    return Learnt(replace(params, sigma_hit_m=spread_m, resolution_m=cell_m), told)


def _updates(sweeps: Iterable[Sweep], params: Params) -> Iterator[tuple[tiles.Beams, NDArray[np.float64]]]:
    """Scans that update the filter, with the step (3,) that led to each."""
    last: NDArray[np.float64] | None = None
    for sweep in sweeps:
        step = None if last is None else step_since(last, sweep.odometry, params)
        if step is not None and not step.far:
            continue
        points = matching.points(sweep, params)
        if points.ends.shape[0]:
            last = np.array([sweep.odometry], np.float64)
            yield beams_of(points, sweep.scan.mount), np.zeros(3) if step is None else step.moved


_Block = list[tuple[tiles.Beams, NDArray[np.float64]]]


def _blocks(sweeps: Iterable[Sweep], params: Params) -> list[_Block]:
    """Every k-th block; k doubles when twice as many as wanted are held, so that memory does not grow with the log."""
    kept: list[_Block] = []
    block: _Block = []
    every, seen = 1, 0
    for update in _updates(sweeps, params):
        block.append(update)
        if len(block) < _BLOCK:
            continue
        if seen % every == 0:
            kept.append(block)
            if len(kept) == 2 * _BLOCKS:
                kept, every = kept[::2], 2 * every
        block, seen = [], seen + 1
    if block and not kept:
        kept.append(block)
    return kept


def _distances(block: _Block, params: Params) -> NDArray[np.float64]:
    """Distances (n,) of the end points that lie on lines from the nearest surface, each scan in the map of those before it."""
    setup = matching.setup(params)
    behind, out = ScanOdometry(setup, block[0][0], np.zeros(3)), [np.zeros(0)]
    for scan, moved in block[1:]:
        match = behind.matched(scan, moved, setup.noise)
        out.append(scan_match.across(behind.map, match.pose[0], ends_of(scan), setup.matcher))
        behind.take(scan, match, float(np.hypot(moved[0], moved[1])))
    return np.concatenate(out)
