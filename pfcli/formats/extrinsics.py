"""Where sensors sit on the robot: static transforms of a log and `--extrinsic` flags, as mounts in the plane."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.errors import LogError, UsageError, printable
from pfcli.events import Pose2

BASE_FRAMES = ("base_link", "base_footprint", "base", "")


class Mount(NamedTuple):
    """A sensor seen from the base frame; `flipped` when it is mounted upside down, `upright` when its z axis points up."""

    pose: Pose2
    flipped: bool = False
    upright: bool = True


class Extrinsics:
    """A tree of static transforms; asks for the pose of any frame in the robot's base frame."""

    def __init__(self) -> None:
        self._parent: dict[str, tuple[str, NDArray[np.float64]]] = {}

    def add(self, parent: str, child: str, transform: NDArray[np.float64]) -> None:
        """transform: (4, 4), the child frame in the parent frame."""
        self._parent[child.lstrip("/")] = (parent.lstrip("/"), transform)

    def add_flags(self, flags: Iterable[str]) -> None:
        """Take `parent:child=x,y,yaw` flags (m, m, rad)."""
        for flag in flags:
            names, _, numbers = flag.partition("=")
            parent, _, child = names.partition(":")
            try:
                x, y, yaw = (float(v) for v in numbers.split(","))
            except ValueError:
                raise UsageError(f"--extrinsic {flag}: expected parent:child=x,y,yaw (m, m, rad)") from None
            if not parent or not child or not math.isfinite(x + y + yaw):
                raise UsageError(f"--extrinsic {flag}: expected parent:child=x,y,yaw (m, m, rad)")
            self.add(parent, child, _planar(x, y, yaw))

    def mount(self, frame: str, path: object, topic: str) -> Mount:
        """Where `frame` sits on the robot. Raises LogError naming the flag that would say it."""
        frame = frame.lstrip("/")
        transform, at, seen = np.eye(4), frame, set[str]()
        while at in self._parent and at not in seen:
            seen.add(at)
            at, step = self._parent[at]
            transform = step @ transform
        if at not in BASE_FRAMES:
            raise LogError(
                f"{path}: topic {printable(topic)!r}, field 'frame_id': no transform from base_link to {printable(frame)!r}"
                f" in /tf_static; give --extrinsic base_link:{printable(frame)}=x,y,yaw"
            )
        yaw = math.atan2(transform[1, 0], transform[0, 0])
        pose = Pose2(float(transform[0, 3]), float(transform[1, 3]), yaw)
        return Mount(pose, bool(transform[2, 2] < 0), bool(transform[2, 2] > 0.99))


def _planar(x: float, y: float, yaw: float) -> NDArray[np.float64]:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def from_transform(translation: Sequence[float], rotation: Sequence[float]) -> NDArray[np.float64]:
    """(4, 4) matrix of a translation and a quaternion x, y, z, w."""
    x, y, z, w = rotation
    out = np.eye(4)
    out[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    out[:3, 3] = translation
    return out
