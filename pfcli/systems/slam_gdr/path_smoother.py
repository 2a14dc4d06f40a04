"""The path as the whole log knows it: a chain of scans, relaxed over all places that the robot came back to.

Of the filter's path it takes where the wheels slipped, and nothing else. Each scan is matched against the map of the way just
behind it, whose shape odometry and scans have hardly bent; what odometry errs by always, and how late it is, comes out of that,
and the chain is made again without. Places are found again however far the chain is off (`core.graph.loop_closure`), then scan
by scan near the path that follows (`revisits`). A pose graph holds it all together, and outvotes what contradicts it.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between
from pfcli.core.graph import loop_closure
from pfcli.core.graph.pose_graph import Edges, Relaxed, joined, relax
from pfcli.core.graph.submaps import Way
from pfcli.core.grid import scan_match, tiles
from pfcli.core.grid.scan_odometry import Setup, drawn, ends_of
from pfcli.core.motion.late_odometry import offset_of_odometry
from pfcli.core.motion.odometry_calibration import Calibration, calibrate
from pfcli.dropped import Dropped
from pfcli.findings import Finding
from pfcli.rng import Purpose, rng_for
from pfcli.systems.slam_gdr.revisits import revisits
from pfcli.systems.slam_gdr.scan_chain import Chain, chained, slips_of, way_of

_EVERY_M = (2.0, 1.0)
"""One scan in so much way is matched against earlier visits: first to find what lies too far off without, then for accuracy."""
_POLISH, _POLISH_SD = 2, (0.03, 0.03, 0.005)
"""How often all scans are matched against the map of all in the end, and how far each may move then (m, m, rad)."""
_DRAWS = 100
_USED = 0.25
"""A closure counts from this weight on."""
_ENOUGH, _OUTVOTED = 20, 0.1
"""Of so many closures, more than this share contradict the others: the path is doubtful."""


class Smoothed(NamedTuple):
    """path: poses of all updates; fits (t,): scans that do not contradict the map of the way behind them; closures, their weights
    (c,); doubted: matches that nothing confirmed; loops: places found however far off; offset_s: how much later odometry is than
    the scans; calibration of the odometry, None where it has hardly moved."""

    path: Relaxed
    fits: NDArray[np.bool_]
    closures: Edges
    weights: NDArray[np.float64]
    doubted: Edges
    loops: int
    offset_s: float
    calibration: Calibration | None

    def summary(self) -> dict[str, Any]:
        """Scalars for run.json."""
        out = {
            "closures": self.closures.first.size,
            "closures_used": int((self.weights > _USED).sum()),
            "loops": self.loops,
            "loops_unconfirmed": self.doubted.first.size,
            "odometry_later_s": self.offset_s,
        }
        if self.calibration is not None:
            errors = self.calibration._asdict()
            out |= {f"odometry_{k}": round(errors[k], 4) + 0.0 for k in ("way", "drift", "turn_per_m", "turn")}
        return out

    def dropped(self) -> Dropped:
        """What of it is to be doubted."""
        out, count = Dropped(), self.closures.first.size
        outvoted = count - int((self.weights > _USED).sum())
        if count >= _ENOUGH and outvoted > _OUTVOTED * count:
            seen = f"{outvoted} of {count} closures contradict the others"
            effect, way_out = "track and map may be wrong there", "see closures.parquet, and the map where they lie"
            out.find(Finding("slam-gdr:W1", "doubt", "", seen, effect, way_out))
        if self.offset_s:
            seen = f"by the turns, odometry of the same moment is stamped {self.offset_s:+.2f} s after a scan"
            effect, way_out = "smoothing took account of it", f"--time-offset scan={self.offset_s} for all else"
            out.find(Finding("slam-gdr:W2", "note", "", seen, effect, way_out))
        return out

    def table(self, stamps_ns: NDArray[np.int64]) -> dict[str, Any]:
        """Closures one by one, for `closures.parquet`. stamps_ns (t,): of all updates."""
        edges = joined((self.closures, self.doubted))
        count = self.closures.first.size
        weights = np.concatenate([self.weights, np.zeros(self.doubted.first.size)])
        sd = np.sqrt(np.diagonal(np.linalg.inv(edges.information), axis1=1, axis2=2))
        named = dict(zip(("x_m", "y_m", "yaw_rad"), edges.measured.T, strict=True))
        named |= dict(zip(("sd_x_m", "sd_y_m", "sd_yaw_rad"), sd.T, strict=True))
        why = np.where(weights > _USED, "", "the others contradict it")
        why[count:] = "no match near it agrees"
        return {
            "first_t_ns": stamps_ns[edges.first],
            "second_t_ns": stamps_ns[edges.second],
            **named,
            "weight": weights,
            "used": weights > _USED,
            "why_not": why.tolist(),
        }


def smooth(
    scans: list[tiles.Beams], steps_at: Callable[[float], NDArray[np.float64]], given: NDArray[np.float64], setup: Setup
) -> Smoothed:
    """The most probable path (t, 3) given the whole log.

    scans: of all updates; steps_at: odometry (t - 1, 3) between them, for an offset of its clock (s); given (t, 3): the filter's
    path, which is asked where the wheels slipped, and nothing else.
    """
    # along a plain wall a scan says nothing: what pulls there is where the map happens to end
    matcher = setup.matcher._replace(map_normals=True, tangent=0.0)
    setup = setup._replace(matcher=matcher)
    chain, offset_s = _calibrated(scans, steps_at, between(given[:-1], given[1:]), setup)
    way = way_of(steps_at(offset_s))
    # the end has no seed of its own, and needs none
    found = loop_closure.find(
        Way(scans, chain.poses, way, chain.fits), chain.edges, setup, rng_for(0, Purpose.SMOOTH, 1)
    )
    loops = joined([c.edges for c in found.accepted])
    closures, relaxed = loops, _relaxed(found.poses, chain, loops)
    for every_m in _EVERY_M:
        closures = joined((loops, revisits(scans, relaxed, chain, way, setup, every_m)))
        relaxed = _relaxed(relaxed.poses, chain, closures)
    weights = relaxed.weights
    for _ in range(_POLISH):
        relaxed = relaxed._replace(poses=_polished(scans, relaxed.poses, chain.fits, setup))
    return Smoothed(
        path=relaxed,
        fits=chain.fits,
        closures=closures,
        weights=weights,
        doubted=joined([c.edges for c in found.doubted]),
        loops=len(found.accepted),
        offset_s=offset_s,
        calibration=calibrate(steps_at(offset_s), between(relaxed.poses[:-1], relaxed.poses[1:])),
    )


def _calibrated(
    scans: list[tiles.Beams],
    steps_at: Callable[[float], NDArray[np.float64]],
    given: NDArray[np.float64],
    setup: Setup,
) -> tuple[Chain, float]:
    """The chain by an odometry without what it errs by always, and how much later its clock is (s)."""
    chain = chained(scans, steps_at(0.0), setup.noise, setup, slips_of(steps_at(0.0), given))
    offset_s = offset_of_odometry(steps_at, chain.steps())
    steps = steps_at(offset_s)
    calibration = calibrate(steps, chain.steps())
    if calibration is not None:
        chain = chained(scans, calibration.corrected(steps), calibration.noise(), setup, slips_of(steps, given))
    return chain, offset_s


def _relaxed(path: NDArray[np.float64], chain: Chain, closures: Edges) -> Relaxed:
    return relax(path, chain.edges, closures, rng_for(0, Purpose.SMOOTH, 0), _DRAWS)


def _polished(
    scans: list[tiles.Beams], poses: NDArray[np.float64], fits: NDArray[np.bool_], setup: Setup
) -> NDArray[np.float64]:
    """Each scan matched against the map of all; the first pose stays."""
    maps = drawn(scans, poses, fits, setup.resolution_m)
    near, out = np.diag(np.square(_POLISH_SD) ** -1.0), poses.copy()
    for k in range(1, len(poses)):
        ends = ends_of(scans[k])
        out[k] = scan_match.match(maps, poses[k : k + 1], near, np.zeros((1, 3)), ends, setup.matcher).pose[0]
    return out
