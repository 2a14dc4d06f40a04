"""Small logs of one drive, told in whatever frames: what a scan sees is a room of 8 x 6 m."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core import rigid
from pfcli.core.rigid import Motion
from pfcli.events import Pose2, Scan
from pfcli.formats.log_writer import LogWriter
from pfcli.formats.message_writer import header
from pfcli.formats.schemas import typestore

S = 1_000_000_000
T0 = 1_700_000_000 * S
LASER = rigid.from_euler((0.2, 0.1, 0.4), 0.0, 0.0, 0.3)
ANGLES = np.radians(np.arange(-90.0, 91.0, 2.0))
WALLS = (5.0, -3.0, 3.5, -2.5)
"""x ahead, x behind, y left, y right of where the robot starts (m)"""


def pose_at(k: int) -> tuple[float, float, float]:
    """Where the robot is at the k-th tenth of a second."""
    yaw = 0.4 * math.sin(0.2 * k)
    return 0.05 * k, 0.02 * k, yaw


def motion_at(k: int) -> Motion:
    """The same, in space."""
    x, y, yaw = pose_at(k)
    return rigid.from_euler((x, y, 0.0), 0.0, 0.0, yaw)


def ranges_at(k: int, laser: Motion = LASER) -> NDArray[np.float32]:
    """What a scanner at `laser` on the robot measures then: walls without end."""
    sensor = motion_at(k) @ laser
    out = np.empty(ANGLES.size)
    for i, angle in enumerate(ANGLES):
        d = sensor[:3, :3] @ np.array([math.cos(angle), math.sin(angle), 0.0])
        far = []
        for axis, walls in ((0, WALLS[:2]), (1, WALLS[2:])):
            for wall in walls:
                t = (wall - sensor[axis, 3]) / d[axis] if d[axis] else -1.0
                if t > 0:
                    far.append(t)
        out[i] = min(far)
    return out.astype(np.float32)


def quaternion(motion: Motion) -> tuple[float, float, float, float]:
    """x, y, z, w of a rotation."""
    r = motion[:3, :3]
    w = math.sqrt(max(0.0, 1 + r[0, 0] + r[1, 1] + r[2, 2])) / 2
    x = math.copysign(math.sqrt(max(0.0, 1 + r[0, 0] - r[1, 1] - r[2, 2])) / 2, r[2, 1] - r[1, 2])
    y = math.copysign(math.sqrt(max(0.0, 1 - r[0, 0] + r[1, 1] - r[2, 2])) / 2, r[0, 2] - r[2, 0])
    z = math.copysign(math.sqrt(max(0.0, 1 - r[0, 0] - r[1, 1] + r[2, 2])) / 2, r[1, 0] - r[0, 1])
    return x, y, z, w


def kind(name: str) -> Any:
    """A message class."""
    return typestore().types[name]


def vector(values: Any) -> Any:
    """geometry_msgs/Vector3."""
    return kind("geometry_msgs/msg/Vector3")(*map(float, values))


def tf(log: LogWriter, topic: str, k: int, rows: list[tuple[str, str, Motion]], scale: float = 1.0) -> None:
    """Append transforms; scale: of the quaternions' length."""
    found = []
    for parent, child, motion in rows:
        turn = kind("geometry_msgs/msg/Quaternion")(*(scale * v for v in quaternion(motion)))
        at = kind("geometry_msgs/msg/Transform")(vector(motion[:3, 3]), turn)
        found.append(kind("geometry_msgs/msg/TransformStamped")(header(_stamp(k), parent), child, at))
    log.message(topic, "tf2_msgs/msg/TFMessage", _stamp(k), kind("tf2_msgs/msg/TFMessage")(found))


def odometry(
    log: LogWriter, k: int, motion: Motion, child: str = "base_link", topic: str = "/odom", **twist: Any
) -> None:
    """Append nav_msgs/Odometry of `child` in `odom`."""
    turn = kind("geometry_msgs/msg/Quaternion")(*quaternion(motion))
    pose = kind("geometry_msgs/msg/Pose")(kind("geometry_msgs/msg/Point")(*map(float, motion[:3, 3])), turn)
    speeds = kind("geometry_msgs/msg/Twist")(
        vector(twist.get("linear", (0, 0, 0))), vector(twist.get("angular", (0, 0, 0)))
    )
    covariance = np.zeros(36)
    covariance[0] = twist.get("covariance", 0.0)
    message = kind("nav_msgs/msg/Odometry")(
        header(_stamp(k), "odom"),
        child,
        kind("geometry_msgs/msg/PoseWithCovariance")(pose, np.zeros(36)),
        kind("geometry_msgs/msg/TwistWithCovariance")(speeds, covariance),
    )
    log.message(topic, "nav_msgs/msg/Odometry", _stamp(k), message)


def scan(log: LogWriter, k: int, laser: Motion = LASER, frame: str = "laser", topic: str = "/scan") -> None:
    """Append the scan of a scanner at `laser`."""
    step = float(ANGLES[1] - ANGLES[0])
    event = Scan(_stamp(k), ranges_at(k, laser), float(ANGLES[0]), step, 0.05, 30.0, Pose2())
    log.scan(event, topic, frame)


def _stamp(k: int) -> int:
    return T0 + k * S // 10


def walls_off(scan_event: Any, k: int) -> float:
    """The farthest that any end point of a scan lies off the walls, seen from the true pose (m)."""
    r, a = scan_event.ranges_m.astype(float), scan_event.directions_rad()
    ok = np.isfinite(r)
    x = scan_event.mount.x_m + r[ok] * np.cos(a[ok])
    y = scan_event.mount.y_m + r[ok] * np.sin(a[ok])
    px, py, yaw = pose_at(k)
    c, s = math.cos(yaw), math.sin(yaw)
    wx, wy = px + c * x - s * y, py + s * x + c * y
    off = np.minimum.reduce([abs(wx - WALLS[0]), abs(wx - WALLS[1]), abs(wy - WALLS[2]), abs(wy - WALLS[3])])
    assert ok.sum() > 20
    return float(off.max())


def simple(
    path: Path, rows: list[tuple[str, str, Motion]], frame: str = "laser", child: str = "base_link", n: int = 3
) -> Path:
    """A log with static transforms, odometry and scans."""
    with LogWriter(path) as log:
        if rows:
            tf(log, "/tf_static", 0, rows)
        for k in range(n):
            odometry(log, k, motion_at(k), child)
            scan(log, k, frame=frame)
    return path
