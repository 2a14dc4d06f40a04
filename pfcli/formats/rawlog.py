"""MRPT `.rawlog`: odometry increments, 2-D laser scans, and ranges and bearings of landmarks.

Source: the serialisation of MRPT's classes: a byte 0x80 + length, the class's name, a version, the fields, 0x88 at the end.
Objects are found by their names, so that classes that are not known here cost nothing but themselves.
"""

import gzip
import math
import re
import struct
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pfcli.errors import LogError, printable, reason
from pfcli.events import Landmarks, Odometry, Pose2, Scan
from pfcli.formats.limits import Reading
from pfcli.formats.memory_log import MemoryLog

_NAME = re.compile(rb"[\x81-\xff](?=(?:mrpt::\w+::)?C[A-Z]\w+)")
_CLASS = re.compile(rb"(?:mrpt::\w+::)?(C[A-Z]\w+)")
_EPOCH = 116_444_736_000_000_000
"""1970 in ticks of 100 ns since 1601."""
_LARGEST = 1 << 30
_PARTS = ("CActionCollection", "CSensoryFrame", "CPose2D", "CPose3D", "CPosePDFGaussian")
"""Classes that hold others."""
_FLAT = 1e-3


class Object(NamedTuple):
    """Class, version, and where the object and its fields begin."""

    name: str
    version: int
    begin: int
    body: int


def is_one(head: bytes) -> bool:
    """Whether a file begins like this, unpacked."""
    return bool(head and head[0] > 0x80 and _CLASS.match(head[1:]))


def read(path: Path, reading: Reading) -> MemoryLog:
    """A log as messages. Raises LogError where it holds nothing that is read."""
    data = _bytes(path)
    objects = _objects(data)
    if objects and objects[0].name not in _PARTS and not objects[0].name.startswith(("CObservation", "CAction")):
        raise LogError(f"{path}: holds a {objects[0].name} of MRPT, which is no log; logs of observations are read")
    return _Drive(path, data, objects, reading).written()


def _bytes(path: Path) -> bytes:
    try:
        with open(path, "rb") as file:
            packed = file.read(2) == b"\x1f\x8b"
        with gzip.open(path, "rb") if packed else open(path, "rb") as file:
            data = file.read(_LARGEST + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise LogError(f"{path}: cannot be read as a log of MRPT ({reason(error)})") from None
    if len(data) > _LARGEST:
        raise LogError(f"{path}: holds more than {_LARGEST >> 30} GiB")
    return data


def _objects(data: bytes) -> list[Object]:
    """The objects in their order, each in front of those inside it."""
    found = []
    for match in _NAME.finditer(data):
        begin = match.start()
        end = begin + 1 + data[begin] - 0x80
        name = _CLASS.fullmatch(data[begin + 1 : end])
        if name and end < len(data):
            found.append(Object(name[1].decode(), data[end], begin, end + 1))
    return found


class _Drive:
    """Goes through the objects: an increment moves the pose, an observation is made there."""

    def __init__(self, path: Path, data: bytes, objects: list[Object], reading: Reading) -> None:
        self._log, self._data, self._objects, self._reading = MemoryLog(path), data, objects, reading
        self._pose = Pose2()
        self._stamp = -1
        self._mounts: dict[Pose2, str] = {}
        self._unread: Counter[str] = Counter()
        self._counts: Counter[str] = Counter()

    def written(self) -> MemoryLog:
        log = self._log
        readers: dict[str, Callable[[int], None]] = {
            "CActionRobotMovement2D": self._move,
            "CObservation2DRangeScan": self._scan,
            "CObservationBearingRange": self._landmarks,
        }
        for k, found in enumerate(self._objects):
            if found.name in _PARTS:
                continue
            try:
                readers[found.name](k)
            except (KeyError, struct.error, ValueError, IndexError):
                self._unread[f"{found.name} (version {found.version})"] += 1
        if not self._counts:
            kinds = ", ".join(f"{count} x {name}" for name, count in self._unread.items()) or "none"
            raise LogError(f"{log.path}: holds no laser scan and no landmark that can be read; its objects are {kinds}")
        for name, count in self._unread.items():
            log.losses.append(f"{log.path}: {count} objects of the class {printable(name)} cannot be read")
        scans, seen = self._counts["scans"], self._counts["detections"]
        log.facts = {"scans": scans, "detections": seen, "odometry": self._counts["odometry"]}
        log.line = f"{scans} scans, {seen} detections of landmarks, {self._counts['odometry']} odometry messages"
        return log

    def _inside(self, k: int, name: str) -> Object:
        """The object of a class inside object k. Raises ValueError."""
        inner = self._objects[k + 1]
        if inner.name != name:
            raise ValueError
        return inner

    def _move(self, k: int) -> None:
        (method,) = struct.unpack_from("<I", self._data, self._objects[k].body)
        inner = self._inside(k, "CPose2D")
        if method != 0 or inner.version != 1 or self._objects[k].version < 2:
            raise ValueError  # an estimate by scans is no odometry
        dx, dy, turn = struct.unpack_from("<3d", self._data, inner.body)
        if not math.isfinite(dx + dy + turn):
            raise ValueError
        x, y, yaw = self._pose
        c, s = math.cos(yaw), math.sin(yaw)
        self._pose = Pose2(x + c * dx - s * dy, y + s * dx + c * dy, math.remainder(yaw + turn, 2 * math.pi))

    def _odometry(self, ticks: int) -> int:
        """The stamp of an observation (ns), after the odometry at it. Raises ValueError."""
        stamp = (ticks - _EPOCH) * 100
        if not 0 <= stamp < 1 << 61:
            raise ValueError
        if stamp != self._stamp:
            self._log.odometry(Odometry(stamp, *self._pose))
            self._counts["odometry"] += 1
            self._stamp = stamp
        return stamp

    def _mount(self, k: int) -> tuple[Pose2, int]:
        """Where the sensor sits, and where the fields behind it begin. Raises ValueError where it is tilted."""
        inner = self._inside(k, "CPose3D")
        count = {1: 6, 2: 7, 3: 12}.get(inner.version, 0)
        values = struct.unpack_from(f"<{count}d", self._data, inner.body)
        end = inner.body + 8 * count
        if count == 0 or self._data[end] != 0x88:
            raise ValueError
        if count == 6:
            yaw, tilt = values[3], abs(values[4]) + abs(values[5])
        elif count == 7:
            w, x, y, z = values[3:]
            yaw, tilt = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), abs(x) + abs(y)
        else:
            yaw, tilt = math.atan2(values[6], values[3]), abs(1 - values[11])
        if not tilt < _FLAT:
            raise ValueError
        return Pose2(round(values[0], 6), round(values[1], 6), round(yaw, 9)), end + 1

    def _scan(self, k: int) -> None:
        data, found = self._data, self._objects[k]
        if not 4 <= found.version <= 6:
            raise ValueError
        aperture, to_the_left, top = struct.unpack_from("<f?f", data, found.body)
        mount, at = self._mount(k)
        (count,) = struct.unpack_from("<I", data, at)
        ranges = np.frombuffer(data, np.float32, count, at + 4).copy()
        valid = np.frombuffer(data, np.uint8, count, at + 4 + 4 * count)
        (ticks,) = struct.unpack_from("<Q", data, at + 8 + 5 * count)
        ranges[valid == 0] = np.inf
        stamp = self._odometry(ticks)
        if mount not in self._mounts:
            self._mounts[mount] = "laser" if not self._mounts else f"laser_{len(self._mounts)}"
            self._log.tf_static(stamp, [("base_link", self._mounts[mount], mount)])
        low = -aperture / 2 if to_the_left else aperture / 2
        step = -2 * low / (count - 1) if count > 1 else 0.0
        scale = self._reading.range_scale
        limit = self._reading.max_range_m or top * scale
        scan = Scan(stamp, (ranges * scale).astype(np.float32), low, step, 0.0, limit, Pose2())
        self._log.scan(scan, frame=self._mounts[mount])
        self._counts["scans"] += 1

    def _landmarks(self, k: int) -> None:
        data, found = self._data, self._objects[k]
        if not 2 <= found.version <= 3:
            raise ValueError
        mount, at = self._mount(k)
        ticks, each = struct.unpack_from("<Q?", data, at)
        if each:
            raise ValueError  # covariances of single readings
        range_sd, bearing_sd, _, count = struct.unpack_from("<3fI", data, at + 9)
        rows = [struct.unpack_from("<3fi", data, at + 25 + 16 * n) for n in range(count)]
        stamp = self._odometry(ticks)
        points = np.array([_placed(mount, r, b, up) for r, b, up, _ in rows]).reshape(-1, 2)
        sigma = np.tile([range_sd, bearing_sd], (count, 1))
        ids = tuple(str(ident) for *_, ident in rows)
        ranges, bearings = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
        self._log.landmarks(Landmarks(stamp, ids, ranges, bearings, sigma))
        self._counts["detections"] += count


def _placed(mount: Pose2, range_m: float, bearing: float, up: float) -> tuple[float, float]:
    """A reading of a sensor as a point on the floor, seen from the base."""
    flat, angle = range_m * math.cos(up), mount.yaw_rad + bearing
    return mount.x_m + flat * math.cos(angle), mount.y_m + flat * math.sin(angle)
