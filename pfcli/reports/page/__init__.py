"""One self-contained HTML page of a run, from the run's own files: no network, no other file."""

import base64
import html
import io
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pfcli.core.grid.grid_map import GridMap
from pfcli.errors import LogError, reason
from pfcli.findings import Finding
from pfcli.formats import map_yaml, parquet
from pfcli.formats.atomic import output_file
from pfcli.registry import system as record_of
from pfcli.reports.charts import ERRORS, marks
from pfcli.systems.shared.chart import Chart

_TRACK_POINTS, _CHART_POINTS = 3000, 1500
_FRAMES, _PARTICLES, _SCAN_POINTS = 250, 100, 90
_MAP_PIXELS = 2_000_000
_HERE = Path(__file__).parent


def write(folder: Path, target: Path) -> int:
    """Write the page of the run in a folder; its size (bytes). Raises LogError where the folder holds no run."""
    text = page(folder).encode()
    with output_file(target) as partial:
        partial.write_bytes(text)
    return len(text)


def page(folder: Path) -> str:
    """The page of the run in a folder."""
    data = describe(folder)
    parts = {
        "@TITLE@": html.escape(data["title"]),
        "@STYLE@": (_HERE / "page.css").read_text(encoding="utf-8"),
        "@SCRIPT@": (_HERE / "page.js").read_text(encoding="utf-8"),
        "@DATA@": json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
    }
    text = (_HERE / "page.html").read_text(encoding="utf-8")
    return re.sub("|".join(parts), lambda mark: parts[mark[0]], text)


def describe(folder: Path) -> dict[str, Any]:
    """What the page shows, as plain values. Raises LogError where the folder holds no whole run."""
    with whole_run(folder):
        return _described(folder)


@contextmanager
def whole_run(folder: Path) -> Iterator[None]:
    """Whatever reading the files of a run trips over becomes one line: they may be another program's, or half of a run."""
    try:
        yield
    except LogError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError, RecursionError, OSError) as error:
        raise LogError(f"{folder}: does not hold a whole run of this version ({reason(error)})") from None


def _described(folder: Path) -> dict[str, Any]:
    summary = summary_of(folder)
    track, metrics = (parquet.read(folder / f"{name}.parquet") for name in ("track", "metrics"))
    frames = parquet.read(folder / "frames.parquet")
    about = parquet.provenance(folder / "track.parquet")
    start = int(track["t_ns"][0])
    layers = _layers(folder)
    landmarks = _landmarks(folder)
    poses = np.column_stack([track[name] for name in ("x_m", "y_m")])
    every = -(-len(poses) // _TRACK_POINTS)
    shown = {name: _rounded(np.asarray(track[f"{name}_m"])[::every], 3) for name in ("x", "y")}
    shown |= {"yaw": _rounded(track["yaw_rad"][::every], 4), "t": _rounded((track["t_ns"][::every] - start) * 1e-9, 3)}
    truth = None
    if "error_x_m" in track:
        shown["error"] = _rounded(track["error_m"][::every], 4)
        truth = {k: _rounded((track[f"{k}_m"] - track[f"error_{k}_m"])[::every], 3) for k in ("x", "y")}
    return {
        "title": f"{about['system']}: {', '.join(Path(log).name for log in summary['logs'])}",
        "command": str(summary.get("command", "")),
        "summary": _headline(summary),
        "notes": [Finding(**row).line for row in summary.get("findings", [])],
        "tables": _tables(summary, about),
        "span": round(float(track["t_ns"][-1] - start) * 1e-9, 3),
        "track": shown,
        "truth": truth,
        "layers": layers,
        "landmarks": landmarks,
        "bounds": _bounds(poses, layers, landmarks),
        "frames": _frames(frames, start),
        "kinds": list(record_of(about["system"]).classes),
        "charts": _charts(about["system"], summary, {"metrics": metrics, "track": track}, start),
    }


def summary_of(folder: Path) -> dict[str, Any]:
    """`run.json` of a run. Raises LogError where the folder holds no run."""
    try:
        found = json.loads((folder / "run.json").read_text())
    except (OSError, ValueError, RecursionError) as error:
        raise LogError(f"{folder}: is not the folder of a run: run.json cannot be read ({reason(error)})") from None
    if not isinstance(found, dict) or "system" not in found:
        raise LogError(f"{folder}: is not the folder of a run: run.json names no system")
    return found


def _headline(summary: Mapping[str, Any]) -> list[list[str]]:
    rows = [
        ["log", ", ".join(Path(log).name for log in summary["logs"])],
        ["time", f"{summary['span_s']:.1f} s"],
        ["way", f"{summary['way_m']:.1f} m"],
        ["scans", str(summary["scans"])],
    ]
    if summary.get("verdict"):
        rows.append(["verdict", "; ".join([summary["verdict"]["grade"], *summary["verdict"]["why"]])])
    if "truth" in summary:
        truth = summary["truth"]
        rows += [
            ["ATE", f"{truth['ate_m']:.3f} m"],
            ["largest error", f"{truth['max_m']:.3f} m"],
        ]
        if truth["heading_rmse_deg"] is not None:
            rows.append(["heading error", f"{truth['heading_rmse_deg']:.2f} deg"])
    known = {"version", "system", "logs", "scans", "span_s", "way_m", "command", "ms_per_update"}
    rows += [
        [name.replace("_", " "), _text(value)]
        for name, value in summary.items()
        if name not in known and isinstance(value, int | float | str)
    ]
    rows += [[name, str(len(summary[name]))] for name in ("crossings", "recoveries") if name in summary]
    rows.append(["time of an update", f"{summary['ms_per_update']:.2f} ms"])
    return rows


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _tables(summary: Mapping[str, Any], about: Mapping[str, Any]) -> list[list[Any]]:
    lost = [[name, str(count)] for name, count in summary.get("lost", {}).items()]
    inputs = [[row["name"], row["sha256"]] for row in about["inputs"]]
    if "map" in about:
        inputs.append([about["map"]["name"], about["map"]["sha256"]])
    return [
        ["Left out", lost],
        ["Read", [[name, str(count)] for name, count in summary.get("read", {}).items()]],
        ["Parameters", [[name, _text(value)] for name, value in about["params"].items()]],
        ["Inputs (SHA-256)", inputs],
        ["How the log was read", [[name, json.dumps(value)] for name, value in about["reading"].items()]],
        ["Versions", [["pfcli", about["version"]], *([k, v] for k, v in summary.get("versions", {}).items())]],
        ["Seconds", [[name, f"{value:.2f}"] for name, value in summary.get("seconds", {}).items()]],
    ]


def _rounded(values: Any, digits: int) -> list[float | None]:
    """Numbers for JSON, None for NaN."""
    array = np.asarray(values, np.float64)
    return [round(v, digits) if finite else None for v, finite in zip(array.tolist(), np.isfinite(array), strict=True)]


def _significant(values: NDArray[np.float64]) -> list[float | None]:
    """Four significant digits."""
    return [float(f"{v:.4g}") if np.isfinite(v) else None for v in values.tolist()]


# --- map -----------------------------------------------------------------------------------------------------


def _layers(folder: Path) -> list[dict[str, Any]]:
    """The map and what lies over it, as images of classes."""
    names = sorted((path.stem for path in folder.glob("*.yaml")), key=lambda name: (name != "map", name))
    return [_layer(map_yaml.read(folder / f"{name}.yaml"), name) for name in names]


def _layer(grid: GridMap, name: str) -> dict[str, Any]:
    cells, side = grid.cells, int(np.ceil(np.sqrt(grid.cells.size / _MAP_PIXELS)))
    if side > 1:  # a cell of the picture is occupied where one of its cells is, else free where one is
        rows, cols = (-(-n // side) * side for n in cells.shape)
        padded = np.full((rows, cols), -1, np.int8)
        padded[: cells.shape[0], : cells.shape[1]] = cells
        cells = padded.reshape(rows // side, side, cols // side, side).max(axis=(1, 3))
    shades = np.array([128, 0, 255], np.uint8)[cells[::-1]]
    out = io.BytesIO()
    Image.fromarray(shades).save(out, "PNG", optimize=True)
    return {
        "name": name,
        "overlay": name != "map",
        "png": "data:image/png;base64," + base64.b64encode(out.getvalue()).decode(),
        "x": grid.origin.x_m,
        "y": grid.origin.y_m,
        "yaw": grid.origin.yaw_rad,
        "cell": grid.resolution_m * side,
        "size": [cells.shape[1], cells.shape[0]],
    }


def _landmarks(folder: Path) -> list[list[float | None]]:
    """x, y, half axes of two standard deviations (m) and their angle (rad)."""
    if not (folder / "landmarks.parquet").is_file():
        return []
    table = parquet.read(folder / "landmarks.parquet")
    found = []
    for x, y, xx, xy, yy in zip(
        *(table[name] for name in ("x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2")), strict=True
    ):
        values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
        a, b = 2.0 * np.sqrt(np.maximum(values, 0.0))
        found.append(_rounded([x, y, a, b, np.arctan2(vectors[1, 0], vectors[0, 0])], 4))
    return found


def _bounds(poses: NDArray[np.float64], layers: list[dict[str, Any]], landmarks: list[Any]) -> list[float]:
    """x, y of the lower left and the upper right corner of all that is shown."""
    points = [poses[np.isfinite(poses).all(axis=1)], np.array([row[:2] for row in landmarks], float).reshape(-1, 2)]
    for layer in layers:
        c, s = np.cos(layer["yaw"]), np.sin(layer["yaw"])
        corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * layer["size"] * layer["cell"]
        points.append(corners @ np.array([[c, s], [-s, c]]) + [layer["x"], layer["y"]])
    joined = np.concatenate(points) if any(map(len, points)) else np.zeros((1, 2))
    return [float(v) for v in (*joined.min(axis=0), *joined.max(axis=0))]


# --- frames --------------------------------------------------------------------------------------------------


def _packed(values: list[NDArray[Any]], dtype: type) -> str:
    joined = np.concatenate(values) if values else np.empty(0)
    return base64.b64encode(joined.astype(dtype).tobytes()).decode()


def _frames(table: dict[str, Any], start: int) -> dict[str, Any]:
    """Particles and scans of evenly spaced updates; positions as 16 bit steps from the middle."""
    count = len(table["t_ns"])
    chosen = (
        np.unique(np.linspace(0, count - 1, min(count, _FRAMES)).round().astype(int)) if count else np.empty(0, int)
    )

    def thinned(name: str, most: int) -> list[NDArray[Any]]:
        rows = [np.asarray(table[name][k]) for k in chosen]
        return [row[:: -(-len(row) // most) or 1] for row in rows]

    x, y = (thinned(f"particle_{k}_m", _PARTICLES) for k in "xy")
    kinds = thinned("particle_class", _PARTICLES)
    scan_x, scan_y = (thinned(f"scan_{k}_cm", _SCAN_POINTS) for k in "xy")
    flat = np.array([np.concatenate(v) if v else np.zeros(1) for v in (x, y)], float).reshape(2, -1)
    flat = flat[:, np.isfinite(flat).all(axis=0)] if flat.size else np.zeros((2, 1))
    flat = flat if flat.size else np.zeros((2, 1))
    origin = (flat.min(axis=1) + flat.max(axis=1)) / 2
    unit = max(0.005, float(np.abs(flat - origin[:, None]).max()) / 32000)

    def steps(rows: list[NDArray[Any]], middle: float) -> list[NDArray[Any]]:
        return [np.nan_to_num(np.rint((row - middle) / unit)) for row in rows]

    pose = np.column_stack([np.asarray(table[name], float)[chosen] for name in ("x_m", "y_m", "yaw_rad")])
    return {
        "t": _rounded((np.asarray(table["t_ns"])[chosen] - start) * 1e-9, 3),
        "pose": [_rounded(row, 4) for row in pose],
        "first": np.cumsum([0, *map(len, x)]).tolist(),
        "x": _packed(steps(x, origin[0]), np.int16),
        "y": _packed(steps(y, origin[1]), np.int16),
        "kind": _packed(kinds, np.uint8),
        "scan": np.cumsum([0, *map(len, scan_x)]).tolist(),
        "sx": _packed(scan_x, np.int16),
        "sy": _packed(scan_y, np.int16),
        "unit": unit,
        "origin": [round(float(v), 4) for v in origin],
    }


# --- charts --------------------------------------------------------------------------------------------------


def _charts(
    system: str, summary: Mapping[str, Any], tables: dict[str, dict[str, Any]], start: int
) -> list[dict[str, Any]]:
    track = tables["track"]
    if "cov_xx_m2" in track:
        with np.errstate(invalid="ignore"):
            track["bound_m"] = 2.0 * np.sqrt(np.asarray(track["cov_xx_m2"]) + np.asarray(track["cov_yy_m2"]))
    wanted = (*record_of(system).charts, *(ERRORS if "error_m" in track else ()))
    found = [_chart(chart, tables[chart.table] | _smoothed(chart, tables), start) for chart in wanted]
    for chart in found:
        chart["marks"] = marks(summary, start)
    over = summary.get("update_ms", {}).get("over_time", [])
    if over:
        t, ms = zip(*over, strict=True)
        row = {"name": "mean", "values": list(ms), "thin": False}
        more = {"title": "time of an update", "unit": "ms", "kind": "line", "low": 0.0, "high": None, "marks": []}
        found.append({"t": list(t), "series": [row], **more})
    return [chart for chart in found if chart["series"]]


def _smoothed(chart: Chart, tables: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Columns that only the track has, at the updates that metrics have rows for."""
    if chart.table != "metrics":
        return {}
    missing = [row.column for row in chart.series if row.column not in tables["metrics"]]
    at = np.searchsorted(tables["track"]["t_ns"], tables["metrics"]["t_ns"]).clip(0, len(tables["track"]["t_ns"]) - 1)
    return {name: np.asarray(tables["track"][name])[at] for name in missing if name in tables["track"]}


def _chart(chart: Chart, table: dict[str, Any], start: int) -> dict[str, Any]:
    t = (np.asarray(table["t_ns"]) - start) * 1e-9
    rows = [(row, np.asarray(table[row.column], float) * row.factor) for row in chart.series if row.column in table]
    rows = [(row, values) for row, values in rows if np.isfinite(values).any()]
    keep = _telling([values for _, values in rows], chart.kind)
    return {
        "title": chart.title,
        "unit": chart.unit,
        "kind": chart.kind,
        "low": chart.low,
        "high": chart.high,
        "t": _rounded(t[keep], 3),
        "series": [{"name": row.name, "values": _significant(values[keep]), "thin": row.thin} for row, values in rows],
    }


def _telling(columns: list[NDArray[np.float64]], kind: str) -> NDArray[np.int64]:
    """Indices of at most so many rows that a chart holds: where it is thinned, the extremes of every piece stay."""
    if not columns or len(columns[0]) <= _CHART_POINTS:
        return np.arange(len(columns[0]) if columns else 0)
    pieces = np.array_split(np.arange(len(columns[0])), _CHART_POINTS // (2 * len(columns)))
    if kind == "stack":
        return np.array([piece[len(piece) // 2] for piece in pieces])
    kept = set[int]()
    for values in columns:
        filled = np.nan_to_num(values)
        for piece in pieces:
            kept |= {int(piece[filled[piece].argmin()]), int(piece[filled[piece].argmax()])}
    return np.array(sorted(kept))
