"""What a run leaves: its tables, maps and texts, what determined them, and the summary in `run.json`."""

import hashlib
import json
import platform
import shlex
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli import __version__
from pfcli.findings import as_rows
from pfcli.formats import map_yaml, parquet, tum
from pfcli.formats.containers import inputs_of
from pfcli.params import to_toml
from pfcli.registry import filter_of
from pfcli.replay.settings import Deskew, Drive
from pfcli.runs.loop import Job, Run
from pfcli.systems.shared.contract import Result

_TIMES = 60
"""Points of the curve of update times."""


_UNSAID: tuple[Any, ...] = (None, (), {}, "", False, Deskew(), (0.0, 0.0))
"""Settings that nobody has made."""


def provenance(job: Job) -> dict[str, Any]:
    """What determines every byte of the tables: version, system, seed, parameters, inputs, how they were read."""
    return {
        "version": __version__,
        "system": job.system.name,
        "seed": job.seed,
        "params": dict(sorted(vars_of(job.params).items())),
        "inputs": [{"name": path.name, "sha256": digest(path)} for path in inputs_of(job.paths)],
        "reading": {k: v for k, v in job.settings._asdict().items() if v not in _UNSAID and k != "limits"},
        "motion": job.motion,
        **({"drive": list(job.drive)} if job.drive != Drive() else {}),
        **_place(job),
        **_files(job.params),
    }


def _place(job: Job) -> dict[str, Any]:
    """The map and the start of a localiser."""
    if job.system.frame != "given":
        return {}
    start = {k: str(v) if isinstance(v, Path) else v for k, v in job.initial._asdict().items() if v is not None}
    if job.map is None:
        return {"initial": start}
    return {"map": {"name": job.map.name, "sha256": digest(job.map)}, "initial": start}


def _files(params: Any) -> dict[str, Any]:
    """Digests of the files that parameters name."""
    named = {k: v for k, v in vars_of(params).items() if isinstance(v, str) and v and Path(v).is_file()}
    return {"files": {k: {"name": Path(v).name, "sha256": digest(Path(v))} for k, v in named.items()}} if named else {}


def vars_of(params: Any) -> dict[str, Any]:
    """Parameters as a plain mapping."""
    return {name: getattr(params, name) for name in params.__dataclass_fields__}


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    now = path.stat()
    return _digest(path.absolute(), now.st_size, now.st_mtime_ns)


@lru_cache(maxsize=4096)
def _digest(path: Path, size: int, mtime_ns: int) -> str:
    """A sweep asks for the same log with every set of parameters."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write(folder: Path, job: Job, run: Run) -> dict[str, Any]:
    """Write every result file into `folder`; returns the summary, which also goes to run.json."""
    meta = provenance(job)
    track = run.result.track
    known = np.isfinite(track.poses).all(axis=1)
    tum.write(folder / "track.tum", track.stamps_ns[known], track.poses[known])
    for name, columns in tables(job, run).items():
        parquet.write(folder / f"{name}.parquet", columns, meta)
    if run.result.grid is not None:
        map_yaml.write(folder, run.result.grid)
    for name, layer in run.result.layers.items():
        map_yaml.write(folder, layer, name)
    for name, text in run.result.texts.items():
        (folder / name).write_text(text)
    (folder / "params.toml").write_text(f"# {job.system.name}, seed {job.seed}\n" + to_toml(job.params))
    summary = summarize(job, run)
    (folder / "run.json").write_text(json.dumps(summary, indent=2) + "\n")
    return summary


def tables(job: Job, run: Run) -> dict[str, dict[str, Any]]:
    """Every table by the name of its file: columns (arrays of equal length) by name."""
    metrics = parquet.columns_of(run.infos, filter_of(job.system).info)
    own = {name: dict(table) for name, table in run.result.tables.items()}
    return {"track": _track_columns(run), "metrics": metrics, "frames": _frame_columns(run.result), **own}


def _track_columns(run: Run) -> dict[str, Any]:
    track = run.result.track
    columns: dict[str, Any] = {"t_ns": track.stamps_ns}
    columns |= dict(zip(("x_m", "y_m", "yaw_rad"), track.poses.T, strict=True))
    columns |= track.columns
    if run.errors is not None:
        columns |= {"error_m": run.errors.position_m, "error_yaw_rad": run.errors.yaw_rad}
        columns |= dict(zip(("error_x_m", "error_y_m"), run.errors.offset_m.T, strict=True))
        columns |= {} if run.errors.nees is None else {"nees": run.errors.nees}
    return columns


def summarize(job: Job, run: Run) -> dict[str, Any]:
    """One object: what ran, what was read and lost, errors, timings (the only place with wall-clock)."""
    track = run.result.track
    moved = np.nansum(np.hypot(*np.diff(track.poses[:, :2], axis=0).T)) if track.stamps_ns.size > 1 else 0.0
    summary: dict[str, Any] = {
        "version": __version__,
        "system": job.system.name,
        "logs": [str(path) for path in job.paths],
        "seed": job.seed,
        "motion": run.motion,
        "scans": int(track.stamps_ns.size),
        "span_s": round(float(track.stamps_ns[-1] - track.stamps_ns[0]) * 1e-9, 3),
        "way_m": round(float(moved), 3),
        "last_pose": _last_pose(track.stamps_ns, track.poses),
        **run.result.summary,
        "read": dict(sorted(run.dropped.read.items())),
        "lost": dict(sorted(run.dropped.counts.items())),
        "findings": as_rows(run.findings),
        "verdict": None if run.verdict is None else run.verdict.row(),
    }
    if run.errors is not None:
        summary["truth"] = run.errors.summary()
    update_ms = 1e3 * run.seconds["loop"] / max(1, len(run.infos))
    summary["command"] = shlex.join(job.command)
    summary["versions"] = _versions()
    summary["update_ms"] = _update_times(run.updates)
    summary["seconds"] = {k: round(v, 4) for k, v in run.seconds.items()}
    summary["ms_per_update"] = round(update_ms, 4)
    return summary


def _last_pose(stamps_ns: NDArray[np.int64], poses: NDArray[np.float64]) -> dict[str, float] | None:
    """Where the track ends; None where no pose is known."""
    known = np.flatnonzero(np.isfinite(poses).all(axis=1))
    if not known.size:
        return None
    names, pose = ("x_m", "y_m", "yaw_rad"), poses[known[-1], :3]
    after_s = round(float(stamps_ns[known[-1]] - stamps_ns[0]) * 1e-9, 3)
    return {"after_s": after_s} | {name: round(float(value), 4) for name, value in zip(names, pose, strict=True)}


def _versions() -> dict[str, str]:
    """What else decides the last bits."""
    packages = ("numpy", "numba", "scipy", "pyarrow", "rosbags")
    return {"python": platform.python_version(), "machine": platform.machine()} | {p: version(p) for p in packages}


def _update_times(updates: NDArray[np.float64]) -> dict[str, Any]:
    """Quantiles of the updates' times, and their means over the run (s since the first, ms)."""
    t, ms = updates[:, 0] - updates[0, 0], 1e3 * updates[:, 1]
    pieces = np.array_split(np.arange(len(ms)), min(_TIMES, len(ms)))
    over = [[round(float(t[piece].mean()), 2), round(float(ms[piece].mean()), 4)] for piece in pieces]
    named = {name: round(float(np.quantile(ms, q)), 4) for name, q in (("median", 0.5), ("p95", 0.95), ("max", 1.0))}
    return named | {"over_time": over}


def _frame_columns(result: Result) -> dict[str, Any]:
    """At most 500 updates with at most 200 particles each and the scan's end points as int16 cm (base frame)."""
    frames = result.frames
    pose = np.array([f.pose for f in frames]).reshape(-1, 3)
    columns: dict[str, Any] = {"t_ns": np.array([f.stamp_ns for f in frames], np.int64)}
    columns |= dict(zip(("x_m", "y_m", "yaw_rad"), pose.T, strict=True))
    for k, name in enumerate(("particle_x_m", "particle_y_m", "particle_yaw_rad")):
        columns[name] = [f.particles[:, k].astype(np.float32) for f in frames]
    columns["particle_class"] = [f.labels for f in frames]
    for k, name in enumerate(("scan_x_cm", "scan_y_cm")):
        columns[name] = [np.clip(np.rint(f.scan_m[:, k] * 100), -32768, 32767).astype(np.int16) for f in frames]
    return columns
