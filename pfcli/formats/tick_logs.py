"""Text logs that hold wheel ticks: tinySLAM / CoreSLAM `.dat`, the LEGO robot's folder, the tricycle's log, OptiOdom's CSV.

Every reader gives the same: events in the order of the file, where the scanner sits, how many lines it could not read,
and what to say on the command line to turn ticks into motion.
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.errors import LogError
from pfcli.events import Pose2, Scan, Ticks, Truth
from pfcli.formats import text_files

_MS, _US = 1_000_000, 1_000
_LATEST_NS = (1 << 31) * 1_000_000_000
_URG_BEAMS, _URG_STEP_RAD = 682, math.radians(360.0 / 1024.0)


class TickLog(NamedTuple):
    """What a log of ticks holds; hint: wheel options for `pfcli`; files: what it was read from."""

    events: list[Ticks | Scan | Truth]
    mount: Pose2
    broken: int
    hint: str
    files: tuple[Path, ...] = ()


def reader_of(source: Path) -> Callable[[Path], TickLog] | None:
    """Which of these formats a file or folder is, by its name and first line; None where it is none of them."""
    if source.is_dir():
        return lego if any(source.glob("*_motors.txt*")) else None
    name = source.name.removesuffix(".gz").removesuffix(".bz2")
    if name.endswith(".dat"):
        return tinyslam
    if name.endswith(".csv"):
        return optiodom if _metadata(source).is_file() else None
    if name.endswith(".txt"):
        if name.endswith(("_motors.txt", "_scan.txt")):
            return lambda file: lego(file.parent)
        return tricycle if next(_lines(source), "").startswith("#kinematic_model") else None
    return None


def files_of(source: Path) -> tuple[Path, ...]:
    """The files that such a log is read from."""
    if source.is_dir():
        return tuple(path for kind in ("motors", "scan") for path in sorted(source.glob(f"*_{kind}.txt*")))
    if source.name.removesuffix(".gz").removesuffix(".bz2").endswith(("_motors.txt", "_scan.txt")):
        return files_of(source.parent)
    about = _metadata(source)
    return (source, about) if source.suffix == ".csv" and about.is_file() else (source,)


def _lines(path: Path) -> Iterator[str]:
    return text_files.lines(path, "a log of ticks")


def tinyslam(source: Path) -> TickLog:
    """CoreSLAM `.dat`: stamp in us, cumulative ticks, 682 ranges of a URG-04LX in mm, 0 where nothing came back.

    Two layouts are about: 24 columns before the scan (ticks in 2 and 3), or 13 (ticks in 1 and 2, the second negated).
    """
    events: list[Ticks | Scan | Truth] = []
    broken = 0
    start = -_URG_STEP_RAD * (_URG_BEAMS - 1) / 2
    for line in _lines(source):
        words = line.split()
        before = {24 + _URG_BEAMS: 24, 25 + _URG_BEAMS: 24, 13 + _URG_BEAMS: 13}.get(len(words))
        try:
            if before is None:
                raise ValueError
            left, right = (int(words[2]), int(words[3])) if before == 24 else (int(words[1]), -int(words[2]))
            stamp = _stamp(int(words[0]) * _US)
            ranges = np.array(words[before : before + _URG_BEAMS], np.float32) * np.float32(1e-3)
        except (ValueError, OverflowError):
            broken += bool(words)
            continue
        events.append(Ticks(stamp, ("left", "right"), np.array([left, right], np.int64), 2000.0, True))
        events.append(Scan(stamp, _none(ranges), start, _URG_STEP_RAD, 0.02, 4.0, Pose2()))
    hint = "--motion encoders --wheel-radius-m 0.077 --track-width-m 0.33"
    return _checked(source, TickLog(events, Pose2(0.145, 0.0, 0.0), broken, hint))


def lego(folder: Path) -> TickLog:
    """A folder with `*_motors.txt` (M lines: ms, ticks of the left and right motor) and `*_scan.txt` (S lines: ms, count,
    ranges in mm), after the SLAM lectures of C. Brenner."""
    motors, scans = (sorted(folder.glob(f"*_{kind}.txt*")) for kind in ("motors", "scan"))
    if len(motors) != 1 or len(scans) != 1:
        raise LogError(f"{folder}: expected one *_motors.txt and one *_scan.txt")
    events: list[Ticks | Scan | Truth] = []
    broken = 0
    for path in (motors[0], scans[0]):
        for line in _lines(path):
            words = line.split()
            try:
                if words and words[0] == "M":
                    ticks = np.array([int(words[2]), int(words[6])], np.int64)
                    events.append(Ticks(_stamp(int(words[1]) * _MS), ("left", "right"), ticks, 360.0, True))
                elif words and words[0] == "S":
                    ranges = np.array(words[3:], np.float32) * np.float32(1e-3)
                    if ranges.size != int(words[2]):
                        raise ValueError
                    low, step = -330 * 0.006135923 - 0.0698132, 0.006135923
                    events.append(Scan(_stamp(int(words[1]) * _MS), _none(ranges), low, step, 0.02, 4.0, Pose2()))
            except (ValueError, IndexError, OverflowError):
                broken += 1
    hint = "--motion encoders --wheel-radius-m 0.019996 --track-width-m 0.155"
    return _checked(folder, TickLog(events, Pose2(0.03, 0.0, 0.0), broken, hint, files_of(folder)))


def tricycle(source: Path) -> TickLog:
    """`time: s ticks: STEERING TRACTION model_pose: x y yaw tracker_pose: x y yaw`; the tracker's pose is that of the
    scanner, 1.5 m ahead, and becomes the truth as it is."""
    events: list[Ticks | Scan | Truth] = []
    broken, tops, mount = 0, (8192.0, 5000.0), (1.5, 0.0)
    for line in _lines(source):
        words = line.replace(":", " ").split()
        try:
            if line.startswith("#joints_max_enc_values"):
                tops = (float(words[1]), float(words[2]))
            elif words and words[0] == "time":
                whole, _, fraction = words[1].partition(".")
                stamp = _stamp(int(whole) * 1_000_000_000 + int((fraction + "0" * 9)[:9]))
                names, ticks = ("steering", "traction"), np.array([int(words[3]), int(words[4])], np.int64)
                x, y, yaw = (float(v) for v in words[10:13])
                events.append(Ticks(stamp, names, ticks, tops[1], True))
                events.append(Truth(stamp, x, y, yaw))
        except (ValueError, IndexError, OverflowError):
            broken += 1
    hint = "a tricycle: steering in 1/8192 turns, traction in 1/5000 turns"
    return _checked(source, TickLog(events, Pose2(*mount, 0.0), broken, hint))


_OMNI3_DEG = (-60, 60, 180)
_MECANUM = ("front_left", "front_right", "rear_left", "rear_right")


def _metadata(source: Path) -> Path:
    return source.with_name(source.name.rpartition("_run")[0] + "_metadata.csv")


def optiodom(source: Path) -> TickLog:
    """OptiOdom `*_run-NN.csv`: time (s), true x, y, yaw, ticks per cycle of each wheel; with its `*_metadata.csv` beside it.

    Positive ticks turn those robots clockwise: the wheels of omni3 are negated, and the left ones of the four of omni4 are
    as they are. Wheels without an encoder's resolution count turns, of which 1/65536 is kept.
    """
    meta = {words[0].strip(): [w for w in words[1:] if w.strip()] for words in _rows(_metadata(source)) if words}
    try:
        kind, turn = meta["type"][0], float(meta["ngear"][0]) * float(meta["encRes"][0])
        arms, diameter = [float(v) for v in meta["Li"]], [float(v) for v in meta["Di"]]
        wheels, _ = {"omni3": 3, "omni4": 4}[kind], (arms[0], diameter[0])
    except (KeyError, IndexError, ValueError):
        raise LogError(f"{_metadata(source)}: fields type (omni3, omni4), ngear, encRes, Li, Di are needed") from None
    fine = 1.0 if turn > 1.0 else 65536.0
    sign = np.array([-1.0] * 3 if wheels == 3 else [1.0, -1.0, 1.0, -1.0])
    names = _MECANUM if wheels == 4 else ("wheel_1", "wheel_2", "wheel_3")
    events: list[Ticks | Scan | Truth] = []
    broken, rolled = 0, np.zeros(wheels)
    for words in _rows(source):
        try:
            stamp = _stamp(round(float(words[0]) * 1e9))
            x, y, yaw = (float(v) for v in words[1:4])
            step = np.array([float(v) for v in words[4 : 4 + wheels]])
            if step.size != wheels or not np.isfinite([x, y, yaw, *step]).all():
                raise ValueError
        except (ValueError, IndexError, OverflowError):
            broken += 1
            continue
        rolled += step
        events.append(Ticks(stamp, names, np.rint(sign * rolled * fine).astype(np.int64), turn * fine, True))
        events.append(Truth(stamp, x, y, yaw))
    radius = f"--motion encoders --wheel-radius-m {diameter[0] / 2:g}"
    angles = " ".join(f"--wheel-angle-deg {a}" for a in _OMNI3_DEG)
    hint = {
        3: f"{radius} --base omni --wheel-joints {','.join(names)} --wheel-arm-m {arms[0]:g} {angles}",
        4: f"{radius} --base mecanum --track-width-m {arms[-1]:g} --axle-distance-m {arms[0]:g}",
    }[wheels]
    return _checked(source, TickLog(events, Pose2(), broken, hint, files_of(source)))


def _rows(path: Path) -> Iterator[list[str]]:
    for line in _lines(path):
        yield line.lstrip("\ufeff").strip().split(",")


def _none(ranges_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Ranges with infinity where the scanner says 0: nothing came back."""
    return np.where(ranges_m <= 0, np.float32(np.inf), ranges_m).astype(np.float32)


def _stamp(ns: int) -> int:
    """A stamp that a message can hold. Raises ValueError for others."""
    if not 0 <= ns < _LATEST_NS:
        raise ValueError
    return ns


def _checked(source: Path, log: TickLog) -> TickLog:
    if not any(isinstance(event, Ticks) for event in log.events):
        raise LogError(f"{source}: holds no line with wheel ticks")
    return log._replace(events=sorted(log.events, key=lambda event: event.stamp_ns))
