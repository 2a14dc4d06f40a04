"""Logs of landmark detections: UTIAS MR.CLAM (a robot's three files) and the world of the SLAM lectures of C. Stachniss.

Both become odometry or speeds, `pfcli.Landmarks`, truth where there is one, and a list of the true landmarks.
"""

import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pfcli.errors import LogError
from pfcli.events import Landmarks, Odometry, Truth, Twist
from pfcli.formats import text_files

_ROBOTS = range(1, 6)
_STEP_NS = 1_000_000_000
_WHAT = "a log of landmarks"
_ROBOT_FILES, _MRCLAM = ("Measurement", "Odometry", "Groundtruth"), ("Barcodes.dat", "Landmark_Groundtruth.dat")


class LandmarkLog(NamedTuple):
    """events in order of time; places: id -> true position (m); robots, unknown: detections that were left out for what they
    are of; broken: lines that could not be read; files: what it was read from."""

    events: list[Twist | Odometry | Landmarks | Truth]
    places: dict[str, tuple[float, float]]
    robots: int
    unknown: int
    broken: int
    files: tuple[Path, ...] = ()


_OF_A_ROBOT = re.compile(r"(Robot\d+)_(Measurement|Odometry|Groundtruth)\.dat(\.gz)?")


def reader_of(source: Path) -> Callable[[Path], LandmarkLog] | None:
    """Which of these formats a file or a folder is, by its name; None where it is none of them.

    Raises LogError for a folder of several robots.
    """
    if source.is_dir():
        robots = sorted(path for path in source.iterdir() if _OF_A_ROBOT.fullmatch(path.name))
        names = sorted({path.name.partition("_")[0] for path in robots})
        if len(names) > 1:
            which = ", ".join(f"{name}_Measurement.dat" for name in names)
            raise LogError(f"{source}: holds {len(names)} robots of MR.CLAM; name one of {which}")
        return (lambda _: mrclam(robots[0])) if names else None
    if _OF_A_ROBOT.fullmatch(source.name):
        return mrclam
    return stachniss if source.name.removesuffix(".gz") == "sensor_data.dat" else None


def files_of(source: Path) -> tuple[Path, ...]:
    """The files that such a log is read from, as far as they are there."""
    if source.is_dir():
        robots = sorted(path for path in source.iterdir() if _OF_A_ROBOT.fullmatch(path.name))
        return files_of(robots[0]) if robots else ()
    robot = _OF_A_ROBOT.fullmatch(source.name)
    names = (
        [f"{robot[1]}_{kind}.dat" for kind in _ROBOT_FILES] + list(_MRCLAM)
        if robot
        else ["sensor_data.dat", "world.dat"]
    )
    beside = [
        path for name in names for path in (source.with_name(name), source.with_name(f"{name}.gz")) if path.is_file()
    ]
    return tuple(beside)


def _rows(path: Path, count: int, broken: list[str]) -> Iterator[list[float]]:
    """Rows of numbers; comments are passed over, other lines counted."""
    for line in text_files.lines(path, _WHAT):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            row = [float(w) for w in words[:count]]
            if len(row) < count or not all(map(math.isfinite, row)):
                raise ValueError
        except ValueError:
            broken.append(line)
            continue
        yield row


def _beside(source: Path, name: str) -> Path:
    """A file of the same folder, compressed or not."""
    found = [path for path in (source.with_name(name), source.with_name(f"{name}.gz")) if path.is_file()]
    if not found:
        raise LogError(f"{source}: needs {name} beside it")
    return found[0]


def mrclam(source: Path) -> LandmarkLog:
    """Any file of a robot: RobotN_Measurement.dat, RobotN_Odometry.dat and RobotN_Groundtruth.dat, with Barcodes.dat and
    Landmark_Groundtruth.dat.

    What a row calls the subject is a barcode. Other robots are left out, and so are codes that nobody has.
    """
    robot = source.name.partition("_")[0]
    broken: list[str] = []
    subject = {int(code): int(who) for who, code in _rows(_beside(source, "Barcodes.dat"), 2, broken)}
    places = {str(int(who)): (x, y) for who, x, y in _rows(_beside(source, "Landmark_Groundtruth.dat"), 3, broken)}
    events: list[Twist | Odometry | Landmarks | Truth] = []
    for t, v, w in _rows(_beside(source, f"{robot}_Odometry.dat"), 3, broken):
        events.append(Twist(_ns(t), v, 0.0, w))
    for t, x, y, yaw in _rows(_beside(source, f"{robot}_Groundtruth.dat"), 4, broken):
        events.append(Truth(_ns(t), x, y, yaw))
    robots = unknown = 0
    seen: dict[int, list[tuple[str, float, float]]] = {}
    for t, code, r, bearing in _rows(_beside(source, f"{robot}_Measurement.dat"), 4, broken):
        who = subject.get(int(code))
        if who is None:
            unknown += 1
        elif who in _ROBOTS:
            robots += 1
        else:
            seen.setdefault(_ns(t), []).append((str(who), r, bearing))
    events += [_detections(stamp, rows) for stamp, rows in seen.items()]
    events.sort(key=lambda event: event.stamp_ns)
    return _checked(source, LandmarkLog(events, places, robots, unknown, len(broken), files_of(source)))


def _ns(seconds: float) -> int:
    return round(seconds * 1e6) * 1000


def _detections(stamp_ns: int, rows: list[tuple[str, float, float]]) -> Landmarks:
    ids, ranges, bearings = zip(*rows, strict=True)
    return Landmarks(stamp_ns, ids, np.array(ranges), np.array(bearings), np.full((len(rows), 2), np.nan))


def stachniss(source: Path) -> LandmarkLog:
    """`sensor_data.dat` with `world.dat`: ODOMETRY turn, way, turn; SENSOR id, range, bearing. Steps are taken 1 s apart."""
    events: list[Twist | Odometry | Landmarks | Truth] = []
    broken: list[str] = []
    places = {str(int(who)): (x, y) for who, x, y in _rows(_beside(source, "world.dat"), 3, broken)}
    x, y, yaw, stamp = 0.0, 0.0, 0.0, _STEP_NS
    events.append(Odometry(stamp, x, y, yaw))
    rows: list[tuple[str, float, float]] = []
    for line in text_files.lines(source, _WHAT):
        words = line.split()
        try:
            if words and words[0] == "ODOMETRY":
                if rows:
                    events.append(_detections(stamp, rows))
                    rows = []
                turn, way, then = (float(w) for w in words[1:4])
                x, y = x + way * math.cos(yaw + turn), y + way * math.sin(yaw + turn)
                yaw, stamp = math.remainder(yaw + turn + then, 2 * math.pi), stamp + _STEP_NS
                events.append(Odometry(stamp, x, y, yaw))
            elif words and words[0] == "SENSOR":
                rows.append((words[1], float(words[2]), float(words[3])))
            elif words:
                raise ValueError
        except (ValueError, IndexError):
            broken.append(line)
    if rows:
        events.append(_detections(stamp, rows))
    return _checked(source, LandmarkLog(events, places, 0, 0, len(broken), files_of(source)))


def _checked(source: Path, log: LandmarkLog) -> LandmarkLog:
    if not any(isinstance(event, Landmarks) for event in log.events):
        raise LogError(f"{source}: holds no detection of a landmark")
    if not log.places:
        raise LogError(f"{source}: the list of landmarks beside it holds none")
    return log
