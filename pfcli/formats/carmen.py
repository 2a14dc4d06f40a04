"""CARMEN logs (`.log`, `.clf`, also gzip and bzip2): ODOM, FLASER and ROBOTLASER1 lines, and their older kin with O and
L lines in cm (Wean Hall).

FLASER lines carry no angles: 180 beams start at -90 deg in steps of 1 deg, 360 at -90 deg in steps of 0.5 deg, an odd
number spans +-90 deg inclusive.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.sensor import no_return
from pfcli.errors import LogError
from pfcli.events import Odometry, Pose2, Scan
from pfcli.formats import text_files

_SECOND = 1_000_000_000
_LATEST_S = 1 << 31
_BEGIN = 2000
"""So many lines are looked at to tell what a file is: parameters may stand in front."""


class Record(NamedTuple):
    """One line: the robot's odometry pose, its velocity (NaN if absent), the stamp's text, and a scan if it has one."""

    odometry: tuple[float, float, float]
    velocity: tuple[float, float]
    stamp: str
    ranges_m: NDArray[np.float32] | None = None
    angles: tuple[float, float] = (0.0, 0.0)
    range_max_m: float = 0.0
    mount: Pose2 = Pose2()


def is_one(path: Path) -> bool:
    """Whether a file is a CARMEN log, by its name or its first lines."""
    if path.name.removesuffix(".gz").removesuffix(".bz2").endswith((".log", ".clf")):
        return True
    try:
        begin = itertools.islice(text_files.lines(path, "a CARMEN log"), _BEGIN)
        return any(line.split(maxsplit=1)[:1] == [word] for line in begin for word in (*_PARSERS, "PARAM"))
    except LogError:
        return False


def read(path: Path) -> tuple[list[Record], int]:
    """All records of a CARMEN log in file order, and how many lines could not be read."""
    records, broken = [], 0
    for line in text_files.lines(path, "a CARMEN log"):
        words = line.split()
        if not words or words[0] not in _PARSERS:
            continue
        try:
            record = _PARSERS[words[0]](words)
            if not _is_stamp(record.stamp) or not np.isfinite([*record.odometry, *record.mount]).all():
                raise ValueError
            records.append(record)
        except (ValueError, IndexError, OverflowError):
            broken += 1
    if not records:
        raise LogError(f"{path}: holds no ODOM, FLASER or ROBOTLASER1 line (nor O and L lines in cm)")
    return records, broken


def _odom(w: list[str]) -> Record:
    x, y, yaw, tv, rv = (float(v) for v in w[1:6])
    if not math.isfinite(x + y + yaw):
        raise ValueError
    return Record((x, y, yaw), (tv, rv), w[7])


def _flaser(w: list[str]) -> Record:
    n = int(w[1])
    ranges = np.array(w[2 : 2 + n], np.float32)
    lx, ly, lyaw, x, y, yaw = (float(v) for v in w[2 + n : 8 + n])
    if ranges.size != n or n < 1 or not math.isfinite(x + y + yaw + lx + ly + lyaw):
        raise ValueError
    step = math.radians(180.0 / (n - 1 if n % 2 else n)) if n > 1 else 0.0
    return Record(
        (x, y, yaw),
        (math.nan, math.nan),
        w[8 + n],
        ranges,
        (-math.pi / 2, step),
        0.0,
        _mount((lx, ly, lyaw), (x, y, yaw)),
    )


def _robotlaser(w: list[str]) -> Record:
    start, _, step, top = (float(v) for v in w[2:6])
    n = int(w[8])
    ranges = np.array(w[9 : 9 + n], np.float32)
    at = 9 + n + 1 + int(w[9 + n])
    laser, robot = [float(v) for v in w[at : at + 3]], [float(v) for v in w[at + 3 : at + 6]]
    tv, rv = float(w[at + 6]), float(w[at + 7])
    if ranges.size != n or n < 1 or not math.isfinite(sum(laser) + sum(robot)):
        raise ValueError
    return Record(
        (robot[0], robot[1], robot[2]), (tv, rv), w[at + 11], ranges, (start, step), top, _mount(laser, robot)
    )


def _bee_odometry(w: list[str]) -> Record:
    """`O x y theta ts` (cm, rad, s)."""
    x, y, yaw = float(w[1]) / 100, float(w[2]) / 100, float(w[3])
    if len(w) != 5 or not math.isfinite(x + y + yaw):
        raise ValueError
    return Record((x, y, yaw), (math.nan, math.nan), w[4])


def _bee_laser(w: list[str]) -> Record:
    """`L x y theta xl yl thetal r1 .. rn ts` (cm, rad, s), beams from the right to the left over 180 degrees."""
    n = len(w) - 8
    x, y, lx, ly = (float(w[k]) / 100 for k in (1, 2, 4, 5))
    yaw, lyaw = float(w[3]), float(w[6])
    ranges = np.array(w[7:-1], np.float32) / np.float32(100)
    if n < 2 or not math.isfinite(x + y + yaw + lx + ly + lyaw):
        raise ValueError
    step = math.radians(180.0 / (n - 1 if n % 2 else n))
    mount = _mount((lx, ly, lyaw), (x, y, yaw))
    return Record((x, y, yaw), (math.nan, math.nan), w[-1], ranges, (-math.pi / 2, step), 0.0, mount)


_PARSERS = {"ODOM": _odom, "FLASER": _flaser, "ROBOTLASER1": _robotlaser, "O": _bee_odometry, "L": _bee_laser}


def _mount(laser: Sequence[float], robot: Sequence[float]) -> Pose2:
    """The laser seen from the robot; rounded to what the log's six digits can tell."""
    (lx, ly, lyaw), (x, y, yaw) = laser, robot
    c, s = math.cos(yaw), math.sin(yaw)
    dx, dy, dyaw = lx - x, ly - y, math.remainder(lyaw - yaw, 2 * math.pi)
    return Pose2(round(c * dx + s * dy, 4) + 0.0, round(-s * dx + c * dy, 4) + 0.0, round(dyaw, 4) + 0.0)


def usable_range_m(records: list[Record]) -> float:
    """Largest range that is a measurement: just below the band of values that the log holds at its top, else the top itself."""
    scans = [r.ranges_m for r in records if r.ranges_m is not None]
    if not scans:
        return math.inf
    stated = max((r.range_max_m for r in records), default=0.0)
    return no_return.usable_m(np.concatenate(scans), stated if stated > 0 else math.inf)


def stamps_ns(texts: list[str], *, repair: bool) -> tuple[list[int], int]:
    """Stamps in ns and how many of them were repaired.

    Some loggers printed the microseconds without their leading zeros (`.040413` became `.404130`). The repair chooses
    for each stamp the division of its fraction by a power of ten that minimises backward steps and jumps (Viterbi).
    """
    plain = [_candidates(text)[0] for text in texts]
    backward = sum(b < a for a, b in itertools.pairwise(plain))
    if not repair or backward <= max(1, len(plain) // 1000):
        return plain, 0
    table = [_candidates(text) for text in texts]
    costs, links = [0.0] * len(table[0]), [[0] * len(table[0])]
    for before, now in itertools.pairwise(table):
        new, link = [], []
        for t in now:
            options = [c + _step_cost((t - p) / _SECOND) for c, p in zip(costs, before, strict=True)]
            best = min(range(len(options)), key=options.__getitem__)
            new.append(options[best])
            link.append(best)
        costs = new
        links.append(link)
    k = min(range(len(costs)), key=costs.__getitem__)
    chosen = []
    for row, link in zip(reversed(table), reversed(links), strict=True):
        chosen.append(row[k])
        k = link[k]
    chosen.reverse()
    return chosen, sum(a != b for a, b in zip(plain, chosen, strict=True))


def _step_cost(dt_s: float) -> float:
    return dt_s * dt_s if dt_s >= 0 else 10.0 - dt_s


def _is_stamp(text: str) -> bool:
    """Whether a word is a decimal number of seconds that a message can hold."""
    whole, _, fraction = text.partition(".")
    return f"{whole}{fraction or 0}".isascii() and f"{whole}{fraction or 0}".isdigit() and int(whole or 0) < _LATEST_S


def _candidates(text: str) -> list[int]:
    """The stamp as printed (ns), then with ever more zeros put back behind the point."""
    whole, _, fraction = text.partition(".")
    seconds = int(whole or 0) * _SECOND
    digits = (fraction + "000000000")[:9]
    found = [seconds + int(digits)]
    short = fraction.ljust(6, "0")[:6]
    while short.endswith("0") and int(short) and len(found) < 6:
        short = "0" + short[:-1]
        found.append(seconds + int(short) * 1000)
    return found


def events(records: list[Record], stamps: list[int], range_max_m: float) -> Iterator[tuple[str, Odometry, Scan | None]]:
    """Each record as (stamp text, odometry, scan or None); every scan brings the odometry of its own line."""
    for record, stamp in zip(records, stamps, strict=True):
        tv, rv = record.velocity
        odometry = Odometry(stamp, *record.odometry, tv, 0.0 if math.isfinite(tv) else math.nan, rv)
        scan = None
        if record.ranges_m is not None:
            scan = Scan(stamp, record.ranges_m, *record.angles, 0.0, range_max_m, record.mount)
        yield record.stamp, odometry, scan
