"""What the whole log says: classes, entries and exits, poses inside and outside, and the map as the robot saw it go on."""

from typing import NamedTuple

import numpy as np

from pfcli.core.grid.grid_map import GridMap
from pfcli.core.grid.tiles import Beams
from pfcli.systems.localize_partial import class_smoother, pose_smoother
from pfcli.systems.localize_partial.class_belief import share_in_map
from pfcli.systems.localize_partial.incomplete_map import Assets
from pfcli.systems.localize_partial.map_extension import extended
from pfcli.systems.localize_partial.params import Params
from pfcli.systems.shared.contract import Result
from pfcli.systems.shared.run_record import RunRecord


class Log(NamedTuple):
    """All updates: their stamps, class probabilities, what was reckoned, and their scans where the map is to be extended."""

    stamps_ns: list[int]
    classes: list[class_smoother.Step]
    reckoned: list[pose_smoother.Reckoned]
    scans: list[Beams]


def empty() -> Log:
    """Before the first update."""
    return Log([], [], [], [])


def result(record: RunRecord, log: Log, particles: int, assets: Assets, params: Params) -> Result:
    """Track with the probability of being in the map, entries and exits; smoothed where `--smooth` says so."""
    in_map = share_in_map(np.array([kept.b for kept in log.classes]))
    columns = {"in_map": in_map}
    layers: dict[str, GridMap] = {}
    if params.smooth:
        smoothed = class_smoother.backward(log.classes)
        for k in range(1, 7):
            columns[f"b{k}_smoothed"] = smoothed[:, k] + (smoothed[:, 0] if k == 3 else 0.0)
        in_map = share_in_map(smoothed)
        columns["in_map_smoothed"] = in_map
    track = record.poses(columns)
    if params.smooth:
        poses = pose_smoother.poses(log.reckoned, in_map)
        record.track.replace(poses, np.full((len(poses), 3, 3), np.nan))
        known = record.poses().poses
        names = ("x_smoothed_m", "y_smoothed_m", "yaw_smoothed_rad")
        track = track._replace(columns=track.columns | dict(zip(names, known.T, strict=True)))
        if params.extend_map:
            layers["extended"] = extended(assets.grid, log.scans, poses)
    summary = {
        "updates": len(log.stamps_ns),
        "crossings": class_smoother.crossings(np.array(log.stamps_ns), in_map),
        "in_map_at_end": round(float(in_map[-1]), 4),
        "unknown_poses": round(float(np.isnan(track.poses[:, 0]).mean()), 4),
        "particles_at_end": particles,
    }
    return Result(
        track=track,
        grid=assets.grid,
        frames=record.frames(),
        summary=summary,
        layers=layers,
        given_frame=True,
    )
