"""Monte Carlo localisation in an incomplete map: six states, one particle cluster each. Zhang 2010 (zhang2010partial).

One update, in the paper's order: particles move and change class (section 2), entries are drawn at the frontiers
(definition 1), the classes' probabilities are predicted (eqs (2)-(12)), the scan weighs particles and classes
(eqs (13)-(23)), and each cluster is resampled on its own.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import particles
from pfcli.core.estimate import PoseEstimate
from pfcli.core.grid import rolling_grid
from pfcli.core.grid.scan_points import Points, beams_of
from pfcli.core.sensor import likelihood_field
from pfcli.events import Sweep
from pfcli.rng import Draw, Purpose
from pfcli.systems.localize_partial import (
    afterwards,
    class_report,
    class_smoother,
    last_metres,
    pose_smoother,
    relocalise,
    unmapped_things,
    update_corrected,
    update_paper,
)
from pfcli.systems.localize_partial.class_belief import Belief, Past, Reading, share_in_map
from pfcli.systems.localize_partial.class_report import Info
from pfcli.systems.localize_partial.incomplete_map import Assets, load
from pfcli.systems.localize_partial.matched_odometry import CELL_M, Reckoning, reckon
from pfcli.systems.localize_partial.params import Params
from pfcli.systems.shared.contract import Filter, Result
from pfcli.systems.shared.motion_gate import update_of
from pfcli.systems.shared.run_record import RunRecord
from pfcli.systems.shared.usable_points import usable_points

_MOST_BEAMS = 400
_PAST, _PAST_EVERY = 10, 2
"""Updates that are kept to ask them again where a robot may be in the map: every second one."""
_SURE = 0.9
"""Share of all mass at one place in the map, from which on the pose counts as known afterwards."""
_MOST_STARTS = 2_000_000


class State(NamedTuple):
    """Particles and class probabilities; odometry (1, 3) of the last update; the pose that odometry and scans reckon; way;
    what the last metres showed, and updates of them; what the end of the run needs."""

    belief: Belief
    odometry: NDArray[np.float64]
    reckoning: Reckoning
    way_m: float
    local: rolling_grid.LocalHistory
    past: list[Past]
    standing: unmapped_things.Standing
    record: RunRecord
    log: afterwards.Log


def init(params: Params, assets: Assets, first: Sweep, draw: Draw) -> State:
    """The belief before the first scan, as `--initial` says."""
    return State(
        belief=_first_belief(params, assets, draw(Purpose.INIT, first.stamp_ns)),
        odometry=np.array([first.odometry], np.float64),
        reckoning=Reckoning(),
        way_m=0.0,
        local=rolling_grid.empty(),
        past=[],
        standing=unmapped_things.at_start(assets.initial.kind),
        record=RunRecord(),
        log=afterwards.empty(),
    )


def _first_belief(params: Params, assets: Assets, rng: np.random.Generator) -> Belief:
    kind = assets.initial.kind
    b = np.zeros(7)
    b[1], b[3] = {"unknown": (0.5, 0.5), "outside": (1.0, 0.0)}.get(kind, (0.0, 1.0))
    pose = np.empty((0, 3))
    if kind == "pose":
        pose = particles.gaussian(np.array(assets.initial.pose), np.array(assets.initial.sd), params.particles, rng)
    elif b[3] > 0.0:
        area = assets.start_xy.shape[0] * assets.grid.resolution_m**2
        n = int(min(max(params.particles, area * params.start_density_per_m2), _MOST_STARTS))
        pose = particles.uniform(assets.start_xy, assets.grid.resolution_m / 2, n, rng, assets.initial.heading)
    if kind in ("unknown", "inside") and assets.initial.heading is None and params.variant != "paper":
        b[0], b[3] = relocalise.MISSED * b[3], (1.0 - relocalise.MISSED) * b[3]
    n = pose.shape[0]
    return Belief(pose=pose, label=np.full(n, 3, np.uint8), weight=np.full(n, b[3] / max(1, n)), b=b)


def step(state: State, sweep: Sweep, assets: Assets, params: Params, draw: Draw) -> tuple[State, Info | None]:
    """Every scan is recorded; one that has moved far enough updates the filter."""
    update = update_of(state.record, state.odometry, sweep, params, _points)
    if update is None:
        return state, None
    now, moved, way_m, _ = update.step
    beams = beams_of(update.used, sweep.scan.mount)
    reckoning, moved = reckon(state.reckoning, beams, moved, way_m, params)
    if params.extend_map:
        state.log.scans.append(beams)
    state = state._replace(odometry=now, reckoning=reckoning, way_m=state.way_m + way_m)
    if reckoning.anew:
        state = state._replace(local=rolling_grid.empty(), past=[])
    reading = _reading(state, update.first, moved, update.used, sweep.stamp_ns, params)
    updated = update_paper.update if params.variant == "paper" else update_corrected.update
    belief = updated(state.belief, reading, assets, params, draw)
    if state.record.updates % _PAST_EVERY == 0:
        state.past.append(Past(reckoning.pose, reading.ends, reading.level, reading.base, belief.credit))
        del state.past[:-_PAST]
    found = class_report.found_pose(belief)
    view_rad = abs(sweep.scan.angle_increment_rad) * sweep.scan.ranges_m.size
    carried = not update.first and unmapped_things.is_carried(reading.base[0], moved[2], view_rad)
    in_map = float(share_in_map(belief.b))
    standing = unmapped_things.after(state.standing, in_map, way_m, reckoning.anew or carried)
    state = state._replace(belief=belief, standing=standing)
    if standing.may_be_inside and class_report.known_inside(belief) and reckoning.astray_m == 0.0:
        sensor = np.array(sweep.scan.mount[:2])
        view = unmapped_things.View(sensor, reading.ends, reading.level)
        unmapped_things.mark(state.local, reckoning.pose, state.way_m, found, view, assets, params)
    return _conclude(state, found, reading)


def _points(sweep: Sweep, params: Params) -> Points | None:
    """The beams that are remembered: all but where there are many."""
    return usable_points(sweep, params, max(_MOST_BEAMS, params.beams), cell_m=CELL_M)


def _reading(
    state: State, first: bool, moved: NDArray[np.float64], points: Points, stamp_ns: int, params: Params
) -> Reading:
    """The beams that weigh, against what the last metres foretold; then the scan belongs to these."""
    scan = np.ascontiguousarray(points.ends.T, np.float32)
    ends = np.ascontiguousarray(scan[:, :: max(1, -(-scan.shape[1] // params.beams))])
    level = likelihood_field.levels_of(ends, params.sigma_hit_m, params.heading_sd_rad)
    reckoned = state.reckoning.pose
    base = last_metres.explained(state.local, reckoned, state.way_m, ends, level, params)
    things = None
    if state.standing.may_be_inside:
        things = rolling_grid.marked(state.local, reckoned, ends, state.way_m, params.history_m)
    rolling_grid.remember(state.local, reckoned, scan, state.way_m, params.history_m)
    return Reading(
        moved=moved,
        first=first,
        ends=ends,
        level=level,
        base=base,
        stamp_ns=stamp_ns,
        reckoned=reckoned,
        past=state.past,
        things=things,
        way_m=state.way_m,
    )


def _conclude(state: State, found: PoseEstimate, reading: Reading) -> tuple[State, Info]:
    """Estimate and record."""
    belief, log, reckoning = state.belief, state.log, state.reckoning
    state.record.report(found, belief.pose, reading.ends.T, belief.label)
    log.stamps_ns.append(reading.stamp_ns)
    log.classes.append(class_smoother.Step(belief.transition, belief.b))
    log.reckoned.append(
        pose_smoother.Reckoned(
            pose=reckoning.pose,
            fits=reckoning.astray_m == 0.0 and not reckoning.anew,
            anew=reckoning.anew,
            lost=bool(belief.b[0] >= 0.5),
            found=found.pose,
            sure=class_report.known_inside(belief) and found.mass >= _SURE,
            way_m=state.way_m,
        )
    )
    return state, class_report.row(belief, found, reading.stamp_ns, state.way_m, reading.ends.shape[1])


def finish(state: State, assets: Assets, params: Params) -> Result:
    """Track with the probability of being in the map, entries and exits."""
    return afterwards.result(state.record, state.log, int(state.belief.pose.shape[0]), assets, params)


FILTER = Filter(info=Info, load=load, init=init, step=step, finish=finish)
