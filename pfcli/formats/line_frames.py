"""Single frames of field lines that soccer teams have published: Falcons' JSON and Carpe Noctem's LinePoints.txt.

A frame becomes a log of one instant: the robot stands still, and the answer of the team's own solver is the truth.
"""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pfcli.errors import LogError, reason
from pfcli.events import Heading, LinePoints, Odometry, Truth
from pfcli.formats import text_files

STAMP_NS = 1_000_000_000


class Frame(NamedTuple):
    """Events of a frame: odometry at rest, the points, and heading or truth where the file has them."""

    events: list[Odometry | LinePoints | Heading | Truth]


def reader_of(source: Path) -> Callable[[Path], Frame] | None:
    """Which of these formats a file is, by its name; None where it is none of them."""
    if source.suffix == ".json":
        return falcons
    return carpe_noctem if source.name.endswith("LinePoints.txt") else None


def falcons(source: Path) -> Frame:
    """Falcons: `Input.landmarks` in the robot's frame (m), `Output.candidates[0].pose` with x along the field's width and y
    along its length; here x runs along the length. Raises LogError for other files."""
    try:
        found = json.loads(text_files.whole(source, "a frame"))
        points = np.array([[p["x"], p["y"]] for p in found["Input"]["landmarks"]], float)
        best = found.get("Output", {}).get("candidates", [])[:1]
        poses = [[float(b["pose"][k]) for k in ("x", "y", "rz")] for b in best]
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise LogError(
            f"{source}: is no frame of the Falcons (field {reason(error)}); Input.landmarks is needed"
        ) from None
    if not all(map(math.isfinite, (v for pose in poses for v in pose))):
        raise LogError(f"{source}: its pose is not finite")
    truth = [Truth(STAMP_NS, y, -x, math.remainder(rz - math.pi / 2, 2 * math.pi)) for x, y, rz in poses]
    return _frame(source, points, truth)


def carpe_noctem(source: Path) -> Frame:
    """Carpe Noctem: rows of x, y (mm, robot's frame) and the robot's heading on the field (rad). Raises LogError for others."""
    try:
        lines = text_files.whole(source, "a frame").splitlines()
        rows = np.loadtxt(lines, ndmin=2) if any(map(str.strip, lines)) else np.empty((0, 0))
    except ValueError:
        rows = np.empty((0, 0))
    if rows.shape[1] != 3:
        raise LogError(f"{source}: is no frame of Carpe Noctem: rows of x, y (mm) and heading (rad) are needed")
    return _frame(source, rows[:, :2] * 1e-3, [Heading(STAMP_NS, float(rows[0, 2]), math.nan)])


def _frame(source: Path, points_m: np.ndarray, more: list[Heading] | list[Truth]) -> Frame:
    if points_m.shape[0] == 0 or not np.isfinite(points_m).all():
        raise LogError(f"{source}: holds no points, or points that are not numbers")
    return Frame([Odometry(STAMP_NS, 0.0, 0.0, 0.0), *more, LinePoints(STAMP_NS, points_m)])
