"""TUM trajectories: `t tx ty tz qx qy qz qw`, the stamp printed from integer nanoseconds."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfcli.errors import LogError
from pfcli.events import stamp_text
from pfcli.formats import text_files

_SECOND = 1_000_000_000
_LATEST_NS = 1 << 62


def stamp_ns(text: str) -> int:
    """Nanoseconds of a decimal stamp, exact for up to nine places; scientific notation is rounded to 1 ns."""
    whole, _, fraction = text.partition(".")
    if whole.lstrip("+-").isdigit() and (fraction == "" or fraction.isdigit()):
        sign = -1 if whole.startswith("-") else 1
        return sign * (abs(int(whole)) * _SECOND + int((fraction + "000000000")[:9]))
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return round(value * _SECOND)


def write(path: Path, stamps_ns: NDArray[np.int64], poses: NDArray[np.float64]) -> None:
    """poses: (n, 3) x, y, yaw (m, m, rad)."""
    with open(path, "w", encoding="ascii") as out:
        for stamp, (x, y, yaw) in zip(stamps_ns.tolist(), poses.tolist(), strict=True):
            out.write(
                f"{stamp_text(stamp)} {x:.6f} {y:.6f} 0.0 0.0 0.0 {math.sin(yaw / 2):.9f} {math.cos(yaw / 2):.9f}\n"
            )


def read(path: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """(stamps ns (n,), poses (n, 3)). Raises LogError naming the line that is wrong."""
    stamps, poses = [], []
    for number, line in enumerate(text_files.lines(path, "a TUM track"), 1):
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            stamp = stamp_ns(words[0])
            x, y, _, qx, qy, qz, qw = (float(w) for w in words[1:8])
            if not -_LATEST_NS < stamp < _LATEST_NS:
                raise ValueError
        except (ValueError, OverflowError):
            raise LogError(f"{path}: line {number} is not `t tx ty tz qx qy qz qw`") from None
        yaw = math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
        if not math.isfinite(x + y + yaw):
            raise LogError(f"{path}: line {number} is not finite")
        stamps.append(stamp)
        poses.append((x, y, yaw))
    if not poses:
        raise LogError(f"{path}: holds no pose")
    return np.array(stamps, np.int64), np.array(poses, np.float64)
