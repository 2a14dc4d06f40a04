"""`overlay.mcap`: the run as standard ROS 2 messages, to open in Foxglove or Rerun beside the log."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from pfcli.core.grid.grid_map import GridMap
from pfcli.events import Pose2
from pfcli.formats.log_writer import LogWriter
from pfcli.formats.message_writer import header, quaternion
from pfcli.formats.schemas import typestore
from pfcli.systems.shared.contract import Result

_HEAD = "geometry_msgs/msg/"


def write(path: Path, result: Result) -> None:
    """Map, its layers and landmarks once; every pose of the track with covariance and transform; particles of kept updates."""
    stamps, poses, columns = result.track.stamps_ns, result.track.poses, result.track.columns
    frames = {f.stamp_ns: f for f in result.frames}
    with LogWriter(path) as log:
        if result.grid is not None:
            _grid(log, "/pfcli/map", int(stamps[0]), result.grid)
        for name, layer in result.layers.items():
            _grid(log, f"/pfcli/{name}", int(stamps[0]), layer)
        if "landmarks" in result.tables:
            table = result.tables["landmarks"]
            places = [_ros_pose((x, y, 0.0)) for x, y in zip(table["x_m"], table["y_m"], strict=True)]
            _poses(log, "/pfcli/landmarks", int(stamps[0]), places)
        for k, stamp in enumerate(stamps.tolist()):
            pose = poses[k].tolist()
            if not all(map(math.isfinite, pose)):
                continue
            _pose(log, stamp, pose, _covariance(columns, k))
            log.tf(stamp, [("map", "base_link_estimate", Pose2(*pose))])
            if stamp in frames:
                _poses(log, "/pfcli/particles", stamp, [_ros_pose(p) for p in frames[stamp].particles.tolist()])


def _covariance(columns: dict[str, Any], k: int) -> Any:
    out = np.zeros(36)
    if "cov_xx_m2" in columns:
        out[0], out[7], out[35] = columns["cov_xx_m2"][k], columns["cov_yy_m2"][k], columns["cov_yawyaw_rad2"][k]
        out[1] = out[6] = columns["cov_xy_m2"][k]
    return out


def _ros_pose(pose: Any) -> Any:
    types = typestore().types
    return types[_HEAD + "Pose"](
        types[_HEAD + "Point"](float(pose[0]), float(pose[1]), 0.0), quaternion(float(pose[2]))
    )


def _pose(log: LogWriter, stamp: int, pose: Any, covariance: Any) -> None:
    types = typestore().types
    body = types[_HEAD + "PoseWithCovariance"](_ros_pose(pose), covariance)
    name = _HEAD + "PoseWithCovarianceStamped"
    log.message("/pfcli/pose", name, stamp, types[name](header(stamp, "map"), body))


def _poses(log: LogWriter, topic: str, stamp: int, poses: list[Any]) -> None:
    kind = typestore().types[_HEAD + "PoseArray"]
    log.message(topic, _HEAD + "PoseArray", stamp, kind(header(stamp, "map"), poses))


def _grid(log: LogWriter, topic: str, stamp: int, grid: GridMap) -> None:
    types = typestore().types
    rows, cols = grid.cells.shape
    when = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    meta = types["nav_msgs/msg/MapMetaData"](when, grid.resolution_m, cols, rows, _ros_pose(grid.origin))
    data = np.where(grid.cells == 1, 100, grid.cells).astype(np.int8).ravel()
    name = "nav_msgs/msg/OccupancyGrid"
    log.message(topic, name, stamp, types[name](header(stamp, "map"), meta, data))
