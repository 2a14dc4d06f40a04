"""Fields of play as YAML: the dimensions of a RoboCup field, or one's own lines.

    length, width, line_width: metres; with them, where the field has them:
    centre_circle, corner_arc: radii; penalty_area, goal_area: [along the goal line, into the field];
    penalty_spot: from the goal line; goal_width; halfway: false leaves the halfway line out
    segments: [[x1, y1, x2, y2], ...]; arcs: [[x, y, radius, from_deg, to_deg], ...]: further lines, by their middles
    landmarks: [{name, kind, x, y}, ...]: what vision can name; kinds of a RoboCup field: post, corner, tee, cross, circle, spot

The origin is the centre, x runs to the opponents' goal, y to the left. Dimensions run to the outer edges of the lines.
"""

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.grid_map import GridMap
from pfcli.core.sensor.field_lines import CELL_M, STEP_M, Lines, Table, build
from pfcli.errors import LogError, UsageError
from pfcli.events import Pose2
from pfcli.formats import text_files

SHIPPED = Path(__file__).resolve().parents[1] / "fields"
_NUMBERS = ("length", "width", "line_width", "centre_circle", "corner_arc", "penalty_spot", "goal_width")
_LONGEST_M = 200.0
_PAIRS = ("penalty_area", "goal_area")
_KNOWN = (*_NUMBERS, *_PAIRS, "halfway", "segments", "arcs", "landmarks")


class Landmark(NamedTuple):
    """Something on the field that vision can name: name (own, once), kind (shared), place (m)."""

    name: str
    kind: str
    x_m: float
    y_m: float


class Field(NamedTuple):
    """Lines and their width (m), landmarks, and whether half a turn maps the lines onto themselves."""

    lines: Lines
    landmarks: tuple[Landmark, ...]
    symmetric: bool
    line_width_m: float


def spoken(name: str) -> str:
    """A landmark's name as it is compared: logs write `post_own_left` or `post own left`."""
    return name.replace("_", " ").strip().lower()


def names() -> list[str]:
    """The fields that come with pfcli."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def read(name: str) -> Field:
    """A field by name or from a YAML file. Raises LogError or UsageError naming the file and the field that is wrong."""
    path = SHIPPED / f"{name}.yaml" if name in names() else Path(name)
    if path.suffix not in (".yaml", ".yml"):
        raise UsageError(f"no field {name!r}; there are {', '.join(names())}, or name a .yaml file")
    values = text_files.mapping(path, "a field")
    if values is None:
        raise LogError(f"{path}: is no field: expected {', '.join(_KNOWN)}")
    return _checked(path, _numbers(path, values))


def _numbers(path: Path, values: dict[str, Any]) -> dict[str, Any]:
    for key in values:
        if key not in _KNOWN:
            raise LogError(f"{path}: field {key!r} is unknown; known: {', '.join(_KNOWN)}")
    for key, size in (*((k, 1) for k in _NUMBERS), *((k, 2) for k in _PAIRS)):
        if key in values:
            given = values[key] if size > 1 else [values[key]]
            if not isinstance(given, list) or len(given) != size or not all(_finite(v) and v > 0 for v in given):
                raise LogError(f"{path}: field {key!r} must hold {size} positive length{'s' * (size > 1)} in metres")
    for key, size in (("segments", 4), ("arcs", 5)):
        rows = values.get(key, [])
        if not isinstance(rows, list) or not all(
            isinstance(row, list) and len(row) == size and all(map(_finite, row)) for row in rows
        ):
            raise LogError(f"{path}: field {key!r} must be a list of rows of {size} numbers")
    for key in ("length", "width"):
        if key not in values:
            raise LogError(f"{path}: field {key!r} is missing: the field's {key} in metres")
        if values[key] > _LONGEST_M:
            raise LogError(f"{path}: field {key!r} is {values[key]:g} m; at most {_LONGEST_M:g} m can be looked up")
    return values


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _checked(path: Path, values: dict[str, Any]) -> Field:
    half = values.get("line_width", 0.125) / 2
    x, y = values["length"] / 2, values["width"] / 2
    segments = [*_segments(values, x - half, y - half, half), *values.get("segments", [])]
    arcs = [*_arcs(values, x - half, y - half, half)]
    arcs += [[a[0], a[1], a[2], math.radians(a[3]), math.radians(a[4])] for a in values.get("arcs", [])]
    lines = Lines(
        np.array(segments, float).reshape(-1, 4),
        np.array(arcs, float).reshape(-1, 5),
        np.array([-x, -y]),
        np.array([x, y]),
    )
    _judge(path, lines)
    own = _own_landmarks(path, values.get("landmarks", []))
    marks = (*_landmarks(values, x - half, y - half, half), *own)
    names = [spoken(mark.name) for mark in marks]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise LogError(f"{path}: field 'landmarks': the name {twice!r} is given twice")
    return Field(lines, marks, _is_symmetric(lines), 2 * half)


def _segments(values: dict[str, Any], x: float, y: float, half: float) -> Iterator[list[float]]:
    """Straight lines by their middles; a box of the field is open at the goal line, which is drawn already."""
    yield from ([-x, -y, x, -y], [-x, y, x, y], [-x, -y, -x, y], [x, -y, x, y])
    if values.get("halfway", True):
        yield [0.0, -y, 0.0, y]
    for key in _PAIRS:
        if key in values:
            along, into = values[key][0] / 2 - half, values[key][1] - 2 * half
            for side in (-1.0, 1.0):
                front = side * (x - into)
                yield from (
                    [side * x, -along, front, -along],
                    [side * x, along, front, along],
                    [front, -along, front, along],
                )


def _arcs(values: dict[str, Any], x: float, y: float, half: float) -> Iterator[list[float]]:
    if "centre_circle" in values:
        yield [0.0, 0.0, values["centre_circle"] - half, 0.0, 2 * math.pi]
    if "corner_arc" in values:
        for quarter, (sx, sy) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
            start = quarter * math.pi / 2
            yield [sx * x, sy * y, values["corner_arc"] - half, start, start + math.pi / 2]


def _landmarks(values: dict[str, Any], x: float, y: float, half: float) -> Iterator[Landmark]:
    for side, sx in (("own", -1.0), ("opponent", 1.0)):
        for hand, sy in (("right", -1.0), ("left", 1.0)):
            where = f"{side} {hand}"
            if "goal_width" in values:
                yield Landmark(f"post {where}", "post", sx * x, sy * values["goal_width"] / 2)
            yield Landmark(f"corner {where}", "corner", sx * x, sy * y)
            for key in _PAIRS:
                if key in values:
                    along, into = values[key][0] / 2 - half, values[key][1] - 2 * half
                    box = key.removesuffix("_area")
                    yield Landmark(f"{box} corner {where}", "corner", sx * (x - into), sy * along)
                    yield Landmark(f"{box} tee {where}", "tee", sx * x, sy * along)
        if "penalty_spot" in values:
            yield Landmark(f"spot {side}", "spot", sx * (x + half - values["penalty_spot"]), 0.0)
    if values.get("halfway", True):
        yield from (
            Landmark(f"halfway tee {hand}", "tee", 0.0, sy * y) for hand, sy in (("right", -1.0), ("left", 1.0))
        )
        if "centre_circle" in values:
            r = values["centre_circle"] - half
            yield from (
                Landmark(f"circle cross {hand}", "cross", 0.0, s * r) for hand, s in (("right", -1.0), ("left", 1.0))
            )
    if "centre_circle" in values:
        yield Landmark("circle", "circle", 0.0, 0.0)


def _own_landmarks(path: Path, rows: Any) -> Iterator[Landmark]:
    for row in rows if isinstance(rows, list) else [rows]:
        good = (
            isinstance(row, dict) and set(row) == {"name", "kind", "x", "y"} and _finite(row["x"]) and _finite(row["y"])
        )
        if not good:
            raise LogError(f"{path}: field 'landmarks' must be a list of {{name, kind, x, y}}")
        yield Landmark(str(row["name"]), str(row["kind"]), float(row["x"]), float(row["y"]))


def _judge(path: Path, lines: Lines) -> None:
    """Raise LogError for lines without length, arcs that are none, and straight lines that cross."""

    def text(row: NDArray[np.float64]) -> str:
        return "[" + ", ".join(f"{v:g}" for v in row) + "]"

    if not 0 < len(lines.segments) + len(lines.arcs) < 256:
        raise LogError(f"{path}: a field has 1 to 255 lines")
    for row in lines.segments:
        if math.hypot(row[2] - row[0], row[3] - row[1]) < 0.01:
            raise LogError(f"{path}: the line {text(row)} has no length (a box smaller than its lines?)")
    for row in lines.arcs:
        if row[2] <= 0.0 or not 0.0 < row[4] - row[3] <= 2 * math.pi + 1e-9:
            raise LogError(f"{path}: the arc {text(row)} needs a radius > 0 and to > from, at most a full circle")
    for a, b in itertools.combinations(lines.segments, 2):
        if _cross(a, b):
            raise LogError(f"{path}: the lines {text(a)} and {text(b)} cross; end them where they meet")


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Whether two segments cross within both: to touch with an end is fine."""

    def side(p: NDArray[np.float64], q: NDArray[np.float64], r: NDArray[np.float64]) -> float:
        length = math.hypot(q[0] - p[0], q[1] - p[1])
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])) / length

    s = side(a[:2], a[2:], b[:2]), side(a[:2], a[2:], b[2:])
    t = side(b[:2], b[2:], a[:2]), side(b[:2], b[2:], a[2:])
    apart = min(map(abs, (*s, *t))) > 0.01
    return apart and s[0] * s[1] < 0 and t[0] * t[1] < 0


def _is_symmetric(lines: Lines) -> bool:
    """Whether half a turn about the centre maps every line onto one."""
    ends = {tuple(np.round(sorted([row[:2].tolist(), row[2:].tolist()]), 6).ravel() + 0.0) for row in lines.segments}
    turned = {
        tuple(np.round(sorted([(-row[:2]).tolist(), (-row[2:]).tolist()]), 6).ravel() + 0.0) for row in lines.segments
    }
    arcs: set[tuple[float, ...]] = set()
    over: set[tuple[float, ...]] = set()
    for x, y, r, start, stop in lines.arcs.tolist():
        whole = stop - start > 2 * math.pi - 1e-6
        for group, sign, turn in ((arcs, 1.0, 0.0), (over, -1.0, math.pi)):
            first = 0.0 if whole else round((start + turn) % (2 * math.pi), 6)
            group.add((round(sign * x, 6) + 0.0, round(sign * y, 6) + 0.0, round(r, 6), first, round(stop - start, 6)))
    return ends == turned and arcs == over


def drawn(field: Field, table: Table | None = None, resolution_m: float = 0.05) -> GridMap:
    """The field as a map: its lines are occupied. table: of its lines, if there is one already."""
    low, high = field.lines.low - 1.0, field.lines.high + 1.0
    cols, rows = (int(v) for v in np.round((high - low) / resolution_m))
    table = build(field.lines) if table is None else table
    x = low[0] + (np.arange(cols) + 0.5) * resolution_m
    y = low[1] + (np.arange(rows) + 0.5) * resolution_m
    col = ((x - table.low[0]) / CELL_M).astype(int)
    row = ((y - table.low[1]) / CELL_M).astype(int)
    near = table.steps.reshape(table.rows, table.cols)[np.ix_(row, col)] * STEP_M <= field.line_width_m / 2
    return GridMap(near.astype(np.int8), resolution_m, Pose2(float(low[0]), float(low[1]), 0.0))
