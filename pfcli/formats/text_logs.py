"""Logs that are no bags, as readers: CARMEN, wheel ticks, landmarks, frames of field lines."""

import itertools
import math
from pathlib import Path

from pfcli.errors import LogError
from pfcli.events import Landmarks, LinePoints, Pose2, Scan, Ticks
from pfcli.formats import carmen, landmark_logs, line_frames, tick_logs
from pfcli.formats.landmark_logs import LandmarkLog
from pfcli.formats.limits import Reading
from pfcli.formats.line_frames import Frame
from pfcli.formats.memory_log import MemoryLog
from pfcli.formats.tick_logs import TickLog

_NO_LIMIT_M = 100.0
"""Usable range of a log whose scans say nothing of it."""


def open_text(path: Path, reading: Reading) -> MemoryLog | None:
    """The log in a file or folder; None where it is none of these. Raises LogError where it is one that cannot be used."""
    marks = landmark_logs.reader_of(path)
    if marks is not None:
        return _landmarks(path, marks(path))
    ticks = tick_logs.reader_of(path)
    if ticks is not None:
        return _ticks(path, ticks(path), reading)
    frame = line_frames.reader_of(path)
    if frame is not None:
        return _frame(path, frame(path))
    return _carmen(path, reading) if path.is_file() and carmen.is_one(path) else None


def _scaled(scan: Scan, reading: Reading) -> Scan:
    """Ranges by `range_scale`, the usable range as it is told, else scaled as well."""
    if reading.range_scale == 1.0 and reading.max_range_m is None:
        return scan
    scale = reading.range_scale
    return scan._replace(
        ranges_m=(scan.ranges_m * scale).astype("float32"),
        range_min_m=scan.range_min_m * scale,
        range_max_m=reading.max_range_m or scan.range_max_m * scale,
    )


def _broken(log: MemoryLog, count: int) -> None:
    log.facts["unreadable_lines"] = count
    if count:
        log.losses.append(f"{log.path}: {count} lines could not be read")


def _ticks(path: Path, found: TickLog, reading: Reading) -> MemoryLog:
    log = MemoryLog(path, found.files)
    scans = sum(isinstance(event, Scan) for event in found.events)
    if scans:
        log.tf_static(found.events[0].stamp_ns, [("base_link", "laser", found.mount)])
    for event in found.events:
        log.event(_scaled(event, reading) if isinstance(event, Scan) else event)
    ticks = sum(isinstance(event, Ticks) for event in found.events)
    log.facts = {"ticks": ticks, "scans": scans, "hint": found.hint}
    log.line = f"{ticks} encoder readings, {scans} scans; {found.hint}"
    _broken(log, found.broken)
    return log


def _landmarks(path: Path, found: LandmarkLog) -> MemoryLog:
    log = MemoryLog(path, found.files)
    for event in found.events:
        log.event(event)
    seen = sum(len(event.ids) for event in found.events if isinstance(event, Landmarks))
    log.places = found.places
    log.facts = {"detections": seen, "robots": found.robots, "unknown_codes": found.unknown}
    log.line = f"{seen} detections of landmarks; {found.robots} of robots, {found.unknown} of unknown codes left out"
    _broken(log, found.broken)
    return log


def _frame(path: Path, found: Frame) -> MemoryLog:
    log = MemoryLog(path)
    for event in found.events:
        log.event(event)
    points = next(event.points_m.shape[0] for event in found.events if isinstance(event, LinePoints))
    log.facts, log.line = {"points": points}, f"one frame of {points} line points"
    return log


def _carmen(path: Path, reading: Reading) -> MemoryLog:
    records, broken = carmen.read(path)
    stamps, repaired = carmen.stamps_ns([r.stamp for r in records], repair=reading.repair_stamps)
    backward = sum(b < a for a, b in itertools.pairwise(stamps))
    told, scale = reading.max_range_m, reading.range_scale
    top = told / scale if told else carmen.usable_range_m(records)
    mounts = {r.mount for r in records if r.ranges_m is not None}
    mount = max(mounts, key=lambda m: sum(r.mount == m for r in records)) if mounts else Pose2()
    log, scans = MemoryLog(path), 0
    log.tf_static(min(stamps), [("base_link", "laser", mount)])
    for text, odometry, scan in carmen.events(records, stamps, top if math.isfinite(top) else _NO_LIMIT_M):
        log.odometry(odometry)
        if scan is not None:
            log.source_stamp(scan.stamp_ns, text)
            log.scan(_scaled(scan, reading))
            scans += 1
    range_m = round(top * scale, 6) if math.isfinite(top) else None
    log.facts = {"scans": scans, "odometry": len(records), "range_max_m": range_m}
    log.facts |= {"repaired_stamps": repaired, "backward_steps": backward}
    told_range = "no range to tell" if range_m is None else f"usable range {range_m:.2f} m"
    log.line = f"{scans} scans, {len(records)} odometry messages, {told_range}, {repaired} stamps repaired"
    if backward:
        log.line += f", {backward} stamps go back in time"
    _broken(log, broken)
    return log


KINDS = (
    "an MCAP file, a rosbag2 folder or .db3, a ROS 1 .bag (each also as .zstd), CARMEN .log/.clf (also .gz, .bz2), MRPT .rawlog,"
    " tinySLAM .dat, a tricycle's .txt, OptiOdom *_run-NN.csv with its *_metadata.csv, a LEGO folder (*_motors.txt and"
    " *_scan.txt), MR.CLAM RobotN_Measurement.dat (beside it RobotN_Odometry.dat, RobotN_Groundtruth.dat, Barcodes.dat and"
    " Landmark_Groundtruth.dat), Stachniss' sensor_data.dat with world.dat, Falcons' .json, Carpe Noctem's LinePoints.txt"
)
"""What can be read."""


def refuse(path: Path) -> LogError:
    """The error for a file that nobody knows."""
    return LogError(f"{path}: is not an MCAP file, and nothing else that can be read: {KINDS}")
