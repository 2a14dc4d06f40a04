"""Reference tracks in the formats that people keep them in: TUM, EuRoC, KITTI, and CSV with named columns.

What a file has no heading of (TUM with three columns or one orientation throughout, a CSV without one) has NaN headings.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfcli.core import rigid
from pfcli.errors import LogError
from pfcli.formats import text_files, tum

_WHAT = "a reference track"
_TIMES = ("timestamp", "time", "stamp", "t", "t_ns", "time_s", "stamp_ns")
_X, _Y = (
    ("x", "x_m", "px", "p_x", "p_rs_r_x", "tx", "position_x"),
    ("y", "y_m", "py", "p_y", "p_rs_r_y", "ty", "position_y"),
)
_YAW = ("yaw", "yaw_rad", "heading", "theta", "heading_rad")
_QUATERNION = tuple((f"q{a}", f"q_{a}", f"q_rs_{a}", f"orientation_{a}") for a in "xyzw")
_UNITS = ((1e17, 1), (1e14, 1_000), (1e11, 1_000_000))
"""Stamps from here on are in units of so many nanoseconds: ns, us, ms since 1970; smaller ones are seconds."""
_STANDS_M, _FEWEST = 1.0, 10

Track = tuple[NDArray[np.int64], NDArray[np.float64]]


def read(path: Path) -> Track:
    """(stamps ns (n,), poses (n, 3), heading NaN where there is none). Raises LogError naming the line that is wrong."""
    rows = [(k, line.strip()) for k, line in enumerate(text_files.lines(path, _WHAT), 1) if line.strip()]
    if not rows:
        raise LogError(f"{path}: holds no pose")
    columns = _columns(rows[0][1])
    if columns is not None:
        return _named(path, columns, rows[1:])
    data = [(k, _words(line)) for k, line in rows if not line.startswith("#")]
    if data and len(data[0][1]) == 12:
        return _kitti(path, data)
    if data and len(data[0][1]) in (3, 4):
        stamps = _stamps([words[0] for _, words in data], path)
        return stamps, _numbers(path, [(k, [*words[1:3], "nan"]) for k, words in data])
    if data and len(data[0][1]) == 8 and _is_large(data[0][1][0]):
        values = _numbers(path, [(k, words[1:]) for k, words in data])
        turned = [_heading(path, k, q) for (k, _), q in zip(data, values[:, 3:].tolist(), strict=True)]
        return _stamps([words[0] for _, words in data], path), np.column_stack([values[:, :2], turned])
    stamps, poses = tum.read(path)
    return stamps, _without_headings(poses)


def _is_large(text: str) -> bool:
    """Whether a stamp is no number of seconds since 1970."""
    try:
        return abs(float(text)) >= _UNITS[-1][0]
    except ValueError:
        return False


def _words(line: str) -> list[str]:
    return line.replace(",", " ").replace(";", " ").split()


def _columns(head: str) -> list[str] | None:
    """Names of the columns of a CSV, without units in brackets; None for a line of numbers."""
    names = [w.partition("[")[0].strip(" #\"'").lower() for w in head.replace(";", ",").split(",")]
    known = any(n in _TIMES for n in names[:2])
    return names if known and len(names) > 2 else None


def _named(path: Path, names: list[str], rows: Sequence[tuple[int, str]]) -> Track:
    def column(options: Sequence[str], wanted: str) -> int:
        found = next((names.index(o) for o in options if o in names), None)
        if found is None:
            raise LogError(f"{path}: has no column {wanted}; it has {', '.join(names)}")
        return found

    time, x, y = column(_TIMES, "timestamp"), column(_X, "x"), column(_Y, "y")
    cells = [
        (k, [c.strip() for c in line.replace(";", ",").split(",")]) for k, line in rows if not line.startswith("#")
    ]
    short = next((k for k, c in cells if len(c) < len(names)), None)
    if short is not None:
        raise LogError(f"{path}: line {short} has fewer columns than the {len(names)} of its head")
    yaw = next((names.index(o) for o in _YAW if o in names), None)
    turn = [next((names.index(o) for o in options if o in names), None) for options in _QUATERNION]
    picked = [x, y, *([yaw] if yaw is not None else [i for i in turn if i is not None] if None not in turn else [])]
    values = _numbers(path, [(k, [c[i] for i in picked]) for k, c in cells])
    poses = np.full((len(cells), 3), math.nan)
    poses[:, :2] = values[:, :2]
    if values.shape[1] == 3:
        poses[:, 2] = values[:, 2]
    elif values.shape[1] == 6:
        poses[:, 2] = [_heading(path, k, q) for (k, _), q in zip(cells, values[:, 2:].tolist(), strict=True)]
    return _stamps([c[time] for _, c in cells], path), poses


def _heading(path: Path, line: int, quaternion: Sequence[float]) -> float:
    try:
        return rigid.yaw_of(rigid.from_quaternion((0.0, 0.0, 0.0), quaternion))
    except ValueError:
        raise LogError(f"{path}: line {line} has a quaternion that is all zero") from None


def _kitti(path: Path, data: Sequence[tuple[int, list[str]]]) -> Track:
    """Rows of 3 x 4 matrices, and the stamps beside them. KITTI's camera looks along z, with x to the right."""
    beside = [path.with_name("times.txt"), path.with_name(f"{path.stem}_times.txt"), path.with_suffix(".times")]
    times = next((p for p in beside if p.is_file()), None)
    if times is None:
        raise LogError(
            f"{path}: has matrices of 12 numbers and no stamps; put them, one a line, beside it as times.txt"
        )
    stamps = _stamps([line.strip() for line in text_files.lines(times, "stamps") if line.strip()], times)
    if stamps.size != len(data):
        raise LogError(f"{times}: holds {stamps.size} stamps, {path} {len(data)} poses")
    m = _numbers(path, data).reshape(-1, 3, 4)
    upright = np.ptp(m[:, 2, 3]) <= np.ptp(m[:, 1, 3])
    if upright:
        return stamps, np.stack([m[:, 0, 3], m[:, 1, 3], np.arctan2(m[:, 1, 0], m[:, 0, 0])], axis=1)
    return stamps, np.stack([m[:, 2, 3], -m[:, 0, 3], np.arctan2(-m[:, 0, 2], m[:, 2, 2])], axis=1)


def _numbers(path: Path, rows: Sequence[tuple[int, Sequence[str]]]) -> NDArray[np.float64]:
    found = []
    for line, words in rows:
        try:
            found.append([float(w) for w in words])
            if len(words) != len(rows[0][1]) or not all(map(math.isfinite, found[-1][:2])):
                raise ValueError
        except ValueError:
            raise LogError(f"{path}: line {line} does not hold {len(rows[0][1])} numbers") from None
    return np.array(found, np.float64).reshape(len(rows), -1)


def _stamps(texts: Sequence[str], path: Path) -> NDArray[np.int64]:
    try:
        return _scaled(np.array([tum.stamp_ns(t) for t in texts], object))
    except (ValueError, OverflowError):
        raise LogError(f"{path}: has a stamp that is no number") from None


def _scaled(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Stamps that were read as seconds, in ns, by how large they are: whole ns, us or ms since 1970 are told apart."""
    seconds = float(np.median(np.abs(stamps.astype(np.float64)))) / 1e9
    unit = next((ns for least, ns in _UNITS if seconds >= least), None)
    if unit is None:
        return stamps.astype(np.int64)
    return np.array([int(s) // (1_000_000_000 // unit) for s in stamps.tolist()], np.int64)


def _without_headings(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """One orientation throughout a way is none."""
    way = np.hypot(*np.diff(poses[:, :2], axis=0).T).sum() if len(poses) > 1 else 0.0
    if len(poses) >= _FEWEST and way > _STANDS_M and np.ptp(poses[:, 2]) == 0.0:
        poses = poses.copy()
        poses[:, 2] = math.nan
    return poses
