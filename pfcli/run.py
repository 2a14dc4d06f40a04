"""The loop shared by all systems: events in, results out."""

import gc
import hashlib
import shlex
import time
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli import __version__, align
from pfcli.core.rows import Rows
from pfcli.core.threads import set_threads
from pfcli.dead_reckoning import Drive
from pfcli.errors import LogError, UsageError, printable
from pfcli.events import Event, Sighting, Sounding, Sweep, Truth
from pfcli.formats import map_yaml, parquet, tum
from pfcli.info_rows import InfoRows
from pfcli.initial import Initial
from pfcli.loss import Loss
from pfcli.params import to_toml
from pfcli.progress import progress
from pfcli.registry import LOCALISERS, System
from pfcli.replay import Log, Settings
from pfcli.rng import Draw
from pfcli.systems.result import Result

if TYPE_CHECKING:
    from pfcli.report.metrics import Errors

_TIMES = 60


class Job(NamedTuple):
    """Everything that determines a run, and how it is shown."""

    system: System
    params: Any
    paths: Sequence[Path]
    seed: int = 0
    settings: Settings = Settings()
    motion: str = "auto"
    drive: Drive = Drive()
    truth: str | None = None
    threads: int = 0
    progress: str = "never"
    map: Path | None = None
    initial: Initial = Initial()
    command: Sequence[str] = ()


class Run(NamedTuple):
    """What a job gave: the system's result, its Info rows, errors against truth, what was lost, timings (s), where motion came
    from, and per update its stamp and how long it took (n, 2), s."""

    result: Result
    infos: InfoRows
    errors: "Errors | None"
    loss: Loss
    seconds: dict[str, float]
    motion: str
    updates: NDArray[np.float64]


def execute(job: Job) -> Run:
    """Replay the logs through the system. Raises LogError or UsageError before running where a need is not met."""
    began = time.perf_counter()
    if job.threads:
        set_threads(job.threads)
    logs = [Log(path, job.settings) for path in job.paths]
    motion = motion_source(logs[0], job.motion)
    roles = _roles(job, logs[0], motion)
    loss = Loss()
    truth: list[Truth] = []
    assets = job.system.load(job.params, job)
    draw = Draw(job.seed)
    state, infos, scans = None, InfoRows(job.system.info), 0
    updates = Rows((2,))
    opened = time.perf_counter()
    gc.freeze()  # what is loaded by now stays; looking through it again and again costs a tenth of the loop
    sweeps = align.sweeps(_without_truth(_replay(logs, roles, loss), truth), motion, job.drive, loss)
    for sweep in progress(_with_data(sweeps, loss), job.progress, job.system.name):
        if state is None:
            state = job.system.init(job.params, assets, sweep, draw)
        start = time.perf_counter()
        state, info = job.system.step(state, sweep, assets, job.params, draw)
        scans += 1
        if info is not None:
            infos.append(info)
            updates.append((sweep.stamp_ns * 1e-9, time.perf_counter() - start))
    looped = time.perf_counter()
    if not infos:
        raise LogError(f"{job.paths[0]}: {_nothing_ran(scans, loss, job.system)}")
    result = job.system.finish(state, assets, job.params)
    if result.loss is not None:
        loss.take(result.loss)
    errors = _errors(job, result, truth)
    seconds = {"open": opened - began, "loop": looped - opened, "finish": time.perf_counter() - looped}
    return Run(result, infos, errors, loss, seconds, motion, updates.array())


def motion_source(log: Log, wanted: str) -> str:
    """Where motion comes from: as asked, else the first of odometry, encoders, twist that the log has."""
    if wanted != "auto":
        return wanted
    return next((role for role in ("odometry", "encoders", "twist") if log.choose(role)), "odometry")


def _reading(job: Job, log: Log) -> str:
    """Which sensor of the system's needs is read: the one that --topic names, else the first that the log has."""
    kinds = [kind for need in job.system.needs for kind in need if kind != "motion"]
    named = [kind for kind in kinds if kind in job.settings.topics]
    return next((kind for kind in named or kinds if log.choose(kind)), kinds[0])


def _roles(job: Job, log: Log, motion: str) -> list[str]:
    """Topics to read; the error names what is missing, what the log has and the flag that maps one."""
    reading = _reading(job, log)
    roles = [*align.ROLES[motion], reading]
    if motion == "imu":
        roles += [r for r in ("twist", "odometry") if log.choose(r)][:1]
    for role in roles:
        if log.choose(role) is None:
            have = (
                ", ".join(f"{printable(t)} ({printable(s) or 'no schema'})" for t, s in log.topics().items())
                or "nothing"
            )
            raise UsageError(
                f"{log.path}: {job.system.name} needs {_NOUNS.get(role, role)}, and the log has {have}{log.damage};"
                f" map a topic with --topic {role}=TOPIC"
                + (" or choose --motion" if role in align.ROLES[motion] else "")
            )
    roles += [r for r in (*job.system.wants, "source_stamp") if r != reading and log.choose(r)]
    if job.truth is not None and not Path(job.truth).is_file():
        if job.truth not in ("auto", ""):
            log.settings = log.settings._replace(topics={**log.settings.topics, "truth": job.truth})
        if log.choose("truth") is None:
            raise UsageError(f"{log.path}: --truth: the log has no truth topic; name one, or a TUM file")
        roles.append("truth")
    return roles


_NOUNS = {
    "odometry": "odometry",
    "scan": "laser scans",
    "range": "range finders",
    "imu": "an IMU",
    "encoders": "wheel encoders",
    "lines": "points of field lines or landmarks",
}


def _replay(logs: list[Log], roles: list[str], loss: Loss) -> Iterator[Event]:
    last = -(1 << 62)
    for log in logs:
        for event in log.events(roles):
            if event.stamp_ns < last:
                raise LogError(
                    f"{log.path}: begins before the log in front of it ends; give the parts in order of time"
                )
            last = event.stamp_ns
            yield event
        loss.take(log.loss)


def _without_truth(events: Iterator[Event], truth: list[Truth]) -> Iterator[Event]:
    for event in events:
        if isinstance(event, Truth):
            truth.append(event)
        else:
            yield event


def _with_data(sweeps: Iterator[Sweep | Sounding | Sighting], loss: Loss) -> Iterator[Sweep | Sounding | Sighting]:
    """Leave out scans without a beam; note a beam count that changes (it is legal, but rarely meant) and long gaps."""
    beams, last = None, None
    for sweep in sweeps:
        if isinstance(sweep, Sighting):
            yield sweep
            continue
        count = sweep.ranges.ranges_m.size if isinstance(sweep, Sounding) else sweep.scan.ranges_m.size
        if count == 0:
            loss.add("empty scan", "topic of the scan, field 'ranges': a scan without beams; such scans are skipped")
            continue
        if beams is not None and count != beams:
            loss.read["scans with another beam count"] += 1
        if last is not None and sweep.stamp_ns - last > 60 * 1_000_000_000:
            loss.read["gaps of more than a minute"] += 1
        beams, last = count, sweep.stamp_ns
        yield sweep


def _nothing_ran(count: int, loss: Loss, system: System) -> str:
    if loss.notes:
        return f"none of its {system.readings} could be used: {loss.notes[0]}"
    if count == 0:
        return f"none of its {system.readings} lies between --start and --end"
    return f"none of its {system.readings} {system.unusable}"


def _errors(job: Job, result: Result, truth: list[Truth]) -> "Errors | None":
    if job.truth is None:
        return None
    from pfcli.report.metrics import align_se2, errors_against

    if truth:
        stamps, poses = np.array([t.stamp_ns for t in truth]), np.array([t[1:4] for t in truth])
    elif Path(job.truth).is_file():
        stamps, poses = tum.read(Path(job.truth))
    else:
        raise LogError(f"{job.paths[0]}: --truth: no truth message could be read")
    aligned = None if result.given_frame else align_se2
    found = errors_against(result.track.stamps_ns, result.track.poses, stamps, poses, aligned)
    return found._replace(nees=found.normalised(result.track.columns))


def provenance(job: Job) -> dict[str, Any]:
    """What determines every byte of the tables: version, system, seed, parameters, inputs, how they were read."""
    return {
        "version": __version__,
        "system": job.system.name,
        "seed": job.seed,
        "params": dict(sorted(vars_of(job.params).items())),
        "inputs": [{"name": path.name, "sha256": digest(path)} for path in job.paths],
        "reading": {k: v for k, v in job.settings._asdict().items() if v not in (None, (), {}) and k != "limits"},
        "motion": job.motion,
        **({"drive": list(job.drive)} if job.drive != Drive() else {}),
        **_place(job),
        **_files(job.params),
    }


def _place(job: Job) -> dict[str, Any]:
    """The map and the start of a localiser."""
    if job.system.name not in LOCALISERS:
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
    import json

    meta = provenance(job)
    track = run.result.track
    known = np.isfinite(track.poses).all(axis=1)
    tum.write(folder / "track.tum", track.stamps_ns[known], track.poses[known])
    columns: dict[str, Any] = {"t_ns": track.stamps_ns}
    columns |= dict(zip(("x_m", "y_m", "yaw_rad"), track.poses.T, strict=True))
    columns |= track.columns
    if run.errors is not None:
        columns |= {"error_m": run.errors.position_m, "error_yaw_rad": run.errors.yaw_rad}
        columns |= dict(zip(("error_x_m", "error_y_m"), run.errors.offset_m.T, strict=True))
        columns |= {} if run.errors.nees is None else {"nees": run.errors.nees}
    parquet.write(folder / "track.parquet", columns, meta)
    parquet.write(folder / "metrics.parquet", parquet.columns_of(run.infos, job.system.info), meta)
    parquet.write(folder / "frames.parquet", _frame_columns(run.result), meta)
    if run.result.grid is not None:
        map_yaml.write(folder, run.result.grid)
    for name, layer in run.result.layers.items():
        map_yaml.write(folder, layer, name)
    for name, table in run.result.tables.items():
        parquet.write(folder / f"{name}.parquet", table, meta)
    for name, text in run.result.texts.items():
        (folder / name).write_text(text)
    (folder / "params.toml").write_text(f"# {job.system.name}, seed {job.seed}\n" + to_toml(job.params))
    summary = summarize(job, run)
    (folder / "run.json").write_text(json.dumps(summary, indent=2) + "\n")
    return summary


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
        **run.result.summary,
        "read": dict(sorted(run.loss.read.items())),
        "lost": dict(sorted(run.loss.counts.items())),
        "notes": run.loss.notes,
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


def _versions() -> dict[str, str]:
    """What else decides the last bits."""
    import platform
    from importlib.metadata import version

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
