"""The loop shared by all systems: events in, a result out. `pfcli.runs.results` writes it."""

import gc
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.checks.evidence import Evidence
from pfcli.checks.stamps_stand_still import check as stand_still
from pfcli.checks.table import judged
from pfcli.core.geometry import compose
from pfcli.core.rows import Rows
from pfcli.core.threads import set_threads
from pfcli.dropped import Dropped
from pfcli.errors import FilterDegenerate, LogError, UsageError
from pfcli.events import Event, Sighting, Sounding, Sweep, Truth
from pfcli.findings import Finding, without
from pfcli.formats import reference_track
from pfcli.initial import Initial
from pfcli.registry import filter_of
from pfcli.replay import align
from pfcli.replay.log import Log
from pfcli.replay.scanners import together
from pfcli.replay.settings import Drive, Settings
from pfcli.rng import Draw
from pfcli.runs import topic_roles, warm
from pfcli.runs.agreement import agreement
from pfcli.runs.info_rows import InfoRows
from pfcli.runs.progress import progress
from pfcli.runs.verdict import Verdict, finding_of, judge
from pfcli.systems.shared.contract import Result, System

if TYPE_CHECKING:
    from pfcli.core.evaluation.track_error import Errors


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
    ignore: Sequence[str] = ()
    """Codes of findings that are silenced."""
    say: Callable[[str], None] = lambda text: None
    """Hears of what takes long before the run begins."""

    @property
    def map_file(self) -> Path:
        """The map's YAML file. Raises UsageError where none was given."""
        if self.map is None:
            raise UsageError(f"{self.system.name} needs a map: --map MAP.yaml")
        return self.map

    def sweeps(self) -> Iterator[Any]:
        """All readings of the run, from its start, for what a system learns beforehand; what is lost is noted by the run."""
        log, dropped = Log(self.paths, self.settings), Dropped()
        motion = topic_roles.motion_source(log, self.motion)
        events = _replay(log, topic_roles.roles_of(self.system, log, motion, self.truth), dropped, Evidence(log.path))
        yield from _sweeps(self, log, events, motion, dropped)

    @property
    def max_map_mpx(self) -> float:
        """Largest map that may be read (million pixels)."""
        return self.settings.limits.map_mpx

    @property
    def unknown_grey(self) -> int:
        """A shade of the map that is unknown whatever its thresholds say (-1: none)."""
        return -1 if self.settings.unknown_grey is None else self.settings.unknown_grey


class Run(NamedTuple):
    """What a job gave: the system's result, its Info rows, errors against truth, what was lost, timings (s), where motion came
    from, per update its stamp and how long it took (n, 2), s, what was noticed about the log and the map, and the verdict
    about the result."""

    result: Result
    infos: InfoRows
    errors: "Errors | None"
    dropped: Dropped
    seconds: dict[str, float]
    motion: str
    updates: NDArray[np.float64]
    findings: Sequence[Finding] = ()
    verdict: Verdict | None = None
    odometry: tuple[NDArray[np.int64], NDArray[np.float64]] | None = None
    """Stamps (n,) ns and raw poses (n, 3) of every reading, in the odometry's own frame."""


def execute(job: Job) -> Run:
    """Replay the logs through the system. Raises LogError or UsageError before running where a need is not met."""
    warm.ensure(job.system, job.say)
    began = time.perf_counter()
    set_threads(job.threads)
    log = Log(job.paths, job.settings)
    motion = topic_roles.motion_source(log, job.motion)
    roles = topic_roles.roles_of(job.system, log, motion, job.truth)
    dropped = Dropped()
    if job.settings.estimate_offset:
        topic_roles.set_clock(log, motion, job.drive, dropped)
    truth: list[Truth] = []
    filter_ = filter_of(job.system)
    assets = filter_.load(job.params, job)
    draw = Draw(job.seed)
    state, infos, scans = None, InfoRows(filter_.info), 0
    updates, stamps, odometry = Rows((2,)), Rows((), np.int64), Rows((3,))
    opened = time.perf_counter()
    gc.freeze()  # what is loaded by now stays; looking through it again and again costs a tenth of the loop
    evidence = Evidence(log.path, map_file=job.map if job.unknown_grey < 0 else None, source=motion)
    sweeps = _sweeps(job, log, _without_truth(_replay(log, roles, dropped, evidence), truth), motion, dropped)
    for sweep in progress(sweeps, job.progress, job.system.name):
        if state is None:
            state = filter_.init(job.params, assets, sweep, draw)
        evidence.moved(sweep.stamp_ns, sweep.odometry)
        start = time.perf_counter()
        try:
            state, info = filter_.step(state, sweep, assets, job.params, draw)
        except (FilterDegenerate, np.linalg.LinAlgError) as error:
            raise _broken(log, error, evidence) from None
        scans += 1
        stamps.append(sweep.stamp_ns)
        odometry.append(sweep.odometry)
        if info is not None:
            infos.append(info)
            updates.append((sweep.stamp_ns * 1e-9, time.perf_counter() - start))
    looped = time.perf_counter()
    still = stand_still(evidence)
    if still is not None and still.code not in job.ignore:
        raise LogError(still.line)
    if not infos:
        why = _nothing_ran(scans, dropped, job.system)
        raise LogError("; ".join([f"{job.paths[0]}: {why}", *_doubts(evidence)]))
    try:
        result = filter_.finish(state, assets, job.params)
    except (FilterDegenerate, np.linalg.LinAlgError) as error:
        raise _broken(log, error, evidence) from None
    if result.dropped is not None:
        dropped.take(result.dropped)
    errors = _errors(job, result, truth)
    finished = time.perf_counter()
    findings = without([*dropped.findings(), *judged(evidence)], job.ignore)
    verdict = judge(agreement(result, evidence), findings)
    findings = without([*findings, *finding_of(verdict)], job.ignore)
    seconds = {"open": opened - began, "loop": looped - opened, "finish": finished - looped}
    seconds["checks"] = time.perf_counter() - finished
    return Run(
        result=result,
        infos=infos,
        errors=errors,
        dropped=dropped,
        seconds=seconds,
        motion=motion,
        updates=updates.array(),
        findings=findings,
        verdict=verdict,
        odometry=(stamps.array(), odometry.array()),
    )


def _replay(log: Log, roles: list[str], dropped: Dropped, evidence: Evidence) -> Iterator[Event]:
    for event in log.events(roles, evidence.stamps):
        evidence.event(event)
        yield event
    dropped.take(log.dropped)


def _sweeps(
    job: Job, log: Log, events: Iterator[Event], motion: str, dropped: Dropped
) -> Iterator[Sweep | Sounding | Sighting]:
    """Readings with the odometry of their moment."""
    kept = (event for event in events if not isinstance(event, Truth))
    single = align.sweeps(kept, motion, job.drive, dropped, deskew=job.settings.deskew)
    return _with_data(together(single, len(log.roles().get("scan", ())), dropped), dropped)


def _without_truth(events: Iterator[Event], truth: list[Truth]) -> Iterator[Event]:
    for event in events:
        if isinstance(event, Truth):
            truth.append(event)
        else:
            yield event


def _with_data(
    sweeps: Iterator[Sweep | Sounding | Sighting], dropped: Dropped
) -> Iterator[Sweep | Sounding | Sighting]:
    """Leave out scans without a beam; note a beam count that changes (it is legal, but rarely meant) and long gaps."""
    beams, last = None, None
    for sweep in sweeps:
        if isinstance(sweep, Sighting):
            yield sweep
            continue
        count = sweep.ranges.ranges_m.size if isinstance(sweep, Sounding) else sweep.scan.ranges_m.size
        if count == 0:
            dropped.add("empty scan", "topic of the scan, field 'ranges': a scan without beams; such scans are skipped")
            continue
        if beams is not None and count != beams:
            dropped.read["scans with another beam count"] += 1
        if last is not None and sweep.stamp_ns - last > 60 * 1_000_000_000:
            dropped.read["gaps of more than a minute"] += 1
        beams, last = count, sweep.stamp_ns
        yield sweep


def _broken(log: Log, error: Exception, evidence: Evidence) -> FilterDegenerate:
    """A filter that could not go on: what it says, and what the checks doubt."""
    what = f"no result can be worked out ({error})" if isinstance(error, np.linalg.LinAlgError) else str(error)
    return FilterDegenerate("; ".join([f"{log.path}: {what}", *_doubts(evidence)]))


def _doubts(evidence: Evidence) -> list[str]:
    """What the checks doubt most, for a run that failed."""
    return [found.line for found in judged(evidence) if found.severity == "doubt"][:1]


def _nothing_ran(count: int, dropped: Dropped, system: System) -> str:
    if dropped.notes:
        return f"none of its {system.readings} could be used: {dropped.notes[0]}"
    if count == 0:
        return f"none of its {system.readings} lies between --start and --end"
    return f"none of its {system.readings} {system.unusable}"


def _errors(job: Job, result: Result, truth: list[Truth]) -> "Errors | None":
    if job.truth is None:
        return None
    from pfcli.core.evaluation.track_error import align_se2, errors_against

    if truth:
        stamps, poses = np.array([t.stamp_ns for t in truth]), np.array([t[1:4] for t in truth])
    elif Path(job.truth).is_file():
        stamps, poses = reference_track.read(Path(job.truth))
    else:
        raise LogError(f"{job.paths[0]}: --truth: no truth message could be read")
    aligned = None if result.given_frame else align_se2
    lever = np.array([[*job.settings.truth_lever_m, 0.0]])
    track = compose(result.track.poses, lever) if lever.any() else result.track.poses
    found = errors_against(result.track.stamps_ns, track, stamps, poses, aligned)
    return found._replace(nees=found.normalised(result.track.columns))
