"""What is said of an update: how the scan fits at the estimate, how far it can be trusted, and the row of `metrics.parquet`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.estimate import PoseEstimate
from pfcli.core.sensor import class_conditional
from pfcli.core.sensor.class_conditional import Fit
from pfcli.systems.localize_reliable import map_change, success_decision
from pfcli.systems.localize_reliable.map_change import MapChanges
from pfcli.systems.localize_reliable.map_models import Assets
from pfcli.systems.localize_reliable.misalignment import misaligned_share
from pfcli.systems.localize_reliable.params import Params
from pfcli.systems.localize_reliable.protection_level import protection_level_m, surface_variance
from pfcli.systems.localize_reliable.scan_weights import Reading
from pfcli.systems.localize_reliable.success_decision import Classifier


class Info(NamedTuple):
    """One update, as a row of `metrics.parquet`; precision: P(a place is right that is trusted and was kept so long), a
    factor of p_success; mae_m, hits, through, unknown_share, misaligned: of the scan at the
    estimate; gl_*: global samples drawn, their matches of key points, and their share of the mass; new_share: of the beams,
    that no key scan showed before; gone: share of the beams, over the last metres, that read far beyond a mapped surface."""

    t_ns: int
    p_success: float
    precision: float
    protection_m: float
    mae_m: float
    hits: float
    through: float
    unknown_share: float
    misaligned: float
    mode_share: float
    sd_m: float
    n_eff: float
    gl_drawn: int
    gl_matches: int
    gl_mass: float
    new_share: float
    gone: float
    log_evidence: float
    resampled: bool
    way_m: float
    beams: int


class Judged(NamedTuple):
    """An estimate: p(success), by the scans and the record of the trusted places, which is its factor `precision`; fit of the
    whole scan; p_unknown (b,) and whether each beam is called unknown (b,); its residual (b,) (m); protection level (m)."""

    p_success: float
    precision: float
    fit: Fit
    p_unknown: NDArray[np.float64]
    unknown: NDArray[np.bool_]
    away_m: NDArray[np.float64]
    protection_m: float


def judged(
    found: PoseEstimate,
    by_scan: float,
    precision: float,
    changes: MapChanges,
    reading: Reading,
    learnt: Classifier | None,
    assets: Assets,
    params: Params,
) -> Judged:
    """The estimate with the classes of the beams (Akai 2023, section 3) and its error bound. by_scan: p(success) by the scans."""
    scan, pose = reading.scan, found.pose
    fit = class_conditional.fit(pose[None], scan, assets.field, reading.model)
    p_unknown, away = class_conditional.classes(pose, scan, assets.field, reading.model)
    safe = _beyond_doubt(pose, by_scan, fit, changes, reading, learnt, assets, params) * precision
    return Judged(
        p_success=by_scan * precision,
        precision=precision,
        fit=fit,
        p_unknown=p_unknown,
        unknown=p_unknown >= params.unknown_threshold,
        away_m=away,
        protection_m=protection_level_m(found.cov, safe, assets.grid, surface_variance(away[p_unknown < 0.5])),
    )


def _beyond_doubt(
    pose: NDArray[np.float64],
    by_scan: float,
    fit: Fit,
    changes: MapChanges,
    reading: Reading,
    learnt: Classifier | None,
    assets: Assets,
    params: Params,
) -> float:
    """p(success) by the scans that a bound in metres may rest on: beams through what is gone speak against it all the same,
    and there is none where the map does not hold. fit: of the whole scan at pose (3,)."""
    if not map_change.map_holds(changes):
        return 0.0
    if learnt is None or reading.counted is reading.scan:
        return by_scan
    rest = class_conditional.fit(pose[None], reading.counted, assets.field, reading.model)
    ratio = success_decision.log_ratio(fit, learnt)[0] - success_decision.log_ratio(rest, learnt)[0]
    left = np.exp(min(0.0, params.decision_gain * float(ratio)))
    return float(by_scan * left / (by_scan * left + 1.0 - by_scan))


class Weighed(NamedTuple):
    """Numbers of the weighing: global samples drawn, their matches of key points and their share of the mass; share of the
    scan that is new; log evidence; effective particles; whether they are resampled; way (m)."""

    drawn: int
    matches: int
    drawn_mass: float
    new_share: float
    log_evidence: float
    n_eff: float
    resampled: bool
    way_m: float


def row(
    found: PoseEstimate, says: Judged, weighed: Weighed, changes: MapChanges, reading: Reading, params: Params
) -> Info:
    """One update."""
    return Info(
        t_ns=reading.stamp_ns,
        p_success=says.p_success,
        precision=says.precision,
        protection_m=says.protection_m,
        mae_m=float(says.fit.mae_m[0]),
        hits=float(says.fit.hits[0]),
        through=float(says.fit.through[0]),
        unknown_share=float(says.unknown.mean()),
        misaligned=misaligned_share(says.away_m, params.sigma_hit_m),
        mode_share=found.mass,
        sd_m=found.sd_m,
        n_eff=weighed.n_eff,
        gl_drawn=weighed.drawn,
        gl_matches=weighed.matches,
        gl_mass=weighed.drawn_mass,
        new_share=weighed.new_share,
        gone=changes.share,
        log_evidence=weighed.log_evidence,
        resampled=weighed.resampled,
        way_m=weighed.way_m,
        beams=reading.scan.range_m.size,
    )
