"""`overlay.mcap`: the run as standard ROS 2 messages, to open in Foxglove or Rerun beside the log."""

from pathlib import Path
from typing import Any

import numpy as np

from pfcli.events import Pose2
from pfcli.formats.log_writer import LogWriter, header, quaternion
from pfcli.formats.schemas import typestore
from pfcli.systems.result import Result

_HEAD = "geometry_msgs/msg/"


def write(path: Path, result: Result) -> None:
    """Map once, every pose of the track with its covariance and transform, particles of every kept update."""
    stamps, poses, columns = result.track.stamps_ns, result.track.poses, result.track.columns
    frames = {f.stamp_ns: f for f in result.frames}
    with LogWriter(path) as log:
        if result.grid is not None:
            _map(log, int(stamps[0]), result)
        for k, stamp in enumerate(stamps.tolist()):
            pose = poses[k].tolist()
            _pose(log, stamp, pose, _covariance(columns, k))
            log.tf(stamp, [("map", "base_link_estimate", Pose2(*pose))])
            if stamp in frames:
                _particles(log, stamp, frames[stamp].particles)


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


def _particles(log: LogWriter, stamp: int, particles: Any) -> None:
    types = typestore().types
    rows = [_ros_pose(p) for p in particles.tolist()]
    log.message("/pfcli/particles", _HEAD + "PoseArray", stamp, types[_HEAD + "PoseArray"](header(stamp, "map"), rows))


def _map(log: LogWriter, stamp: int, result: Result) -> None:
    types = typestore().types
    grid = result.grid
    assert grid is not None
    rows, cols = grid.cells.shape
    when = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    meta = types["nav_msgs/msg/MapMetaData"](when, grid.resolution_m, cols, rows, _ros_pose(grid.origin))
    data = np.where(grid.cells == 1, 100, grid.cells).astype(np.int8).ravel()
    name = "nav_msgs/msg/OccupancyGrid"
    log.message("/pfcli/map", name, stamp, types[name](header(stamp, "map"), meta, data))
