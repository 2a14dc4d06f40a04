"""`pfcli convert IN OUT`."""

import itertools
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pfcli.cli.types import Finite, streamed
from pfcli.errors import LogError, UsageError
from pfcli.formats.atomic import check_file

if TYPE_CHECKING:
    from pfcli.events import Scan
    from pfcli.formats.landmark_logs import LandmarkLog
    from pfcli.formats.line_frames import Frame
    from pfcli.formats.tick_logs import TickLog


@click.command()
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("target", type=click.Path(path_type=Path))
@click.option(
    "--range-max",
    type=Finite(0, 10_000, min_open=True),
    default=None,
    help="Usable range of the scanner [m]; default: just below the value the log repeats at its top.",
)
@click.option(
    "--range-scale",
    type=Finite(0, 100, min_open=True),
    default=1.0,
    show_default=True,
    help="Multiply all ranges: for scanners whose metre is not one.",
)
@click.option(
    "--repair-stamps/--no-repair-stamps",
    default=True,
    help="Mend stamps whose microseconds lost their leading zeros.  (default: on)",
)
@click.option("--compression", type=click.Choice(["zstd", "lz4", "none"]), default="zstd", show_default=True)
@click.option("--force", is_flag=True, help="Replace TARGET.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as one JSON object.")
def convert(source: Path, target: Path, **given: Any) -> int:
    """Convert SOURCE to an MCAP log; TARGET `-`: to standard output.

    SOURCE: CARMEN .log/.clf, also .gz and .bz2; ROS 1 .bag; a rosbag2 folder or .db3; tinySLAM .dat, the folder of a LEGO
    robot, a tricycle's .txt or OptiOdom's .csv, whose wheel ticks stay ticks; a frame of field lines (Falcons' .json,
    Carpe Noctem's LinePoints.txt); landmarks (MR.CLAM's RobotN_Measurement.dat, Stachniss' sensor_data.dat).

    Example: pfcli convert intel.clf.bz2 intel.mcap
    """
    with streamed(target) as place:
        return _written(source, place, **given)


def _written(
    source: Path,
    target: Path,
    range_max: float | None,
    range_scale: float,
    repair_stamps: bool,
    compression: str,
    force: bool,
    as_json: bool,
) -> int:
    from pfcli.cli.printing import emit, lost, say
    from pfcli.formats import landmark_logs, line_frames, rosbag, tick_logs

    check_file(target, force=force)
    if not source.exists():
        raise LogError(f"{source}: no such file")
    if target.exists() and target.samefile(source):
        raise UsageError(f"{target}: is the log itself; name another file")
    marks = landmark_logs.reader_of(source)
    if marks is not None:
        return _landmarks(marks(source), target, compression, force, as_json)
    reader = tick_logs.reader_of(source)
    if reader is not None:
        return _ticks(reader(source), target, (range_scale, range_max), compression, as_json)
    frame = line_frames.reader_of(source)
    if frame is not None:
        return _frame(frame(source), target, compression, as_json)
    if source.suffix in (".bag", ".db3") or source.is_dir():
        counts: dict[str, Any] = rosbag.convert(source, target, compression)
        emit(
            counts, [f"{target}: {counts['messages']} messages, {counts['skipped']} of unknown types left out"], as_json
        )
        return 0
    found = _carmen(source, target, (range_scale, range_max), repair_stamps, compression)
    for note in found.pop("notes"):
        say(note)
    line = (
        f"{target}: {found['scans']} scans, {found['odometry']} odometry messages, {_range_text(found['range_max_m'])},"
        f" {found['repaired_stamps']} stamps repaired"
    )
    emit(found, [line], as_json)
    return lost({"unreadable line": found["unreadable_lines"]} if found["unreadable_lines"] else {}, [])


def _range_text(range_m: float | None) -> str:
    return "no range to tell" if range_m is None else f"usable range {range_m:.2f} m"


def _ticks(log: "TickLog", target: Path, ranges: tuple[float, float | None], compression: str, as_json: bool) -> int:
    from pfcli.cli.printing import emit, lost
    from pfcli.events import Scan, Ticks
    from pfcli.formats.log_writer import LogWriter

    scans = sum(isinstance(event, Scan) for event in log.events)
    with LogWriter(target, compression) as out:
        if scans:
            out.tf_static(log.events[0].stamp_ns, [("base_link", "laser", log.mount)])
        for event in log.events:
            out.event(_scaled(event, ranges) if isinstance(event, Scan) else event)
    ticks = sum(isinstance(event, Ticks) for event in log.events)
    found = {"out": str(target), "ticks": ticks, "scans": scans, "unreadable_lines": log.broken, "hint": log.hint}
    emit(found, [f"{target}: {ticks} encoder readings, {scans} scans; {log.hint}"], as_json)
    return lost({"unreadable line": log.broken} if log.broken else {}, [])


def _landmarks(log: "LandmarkLog", target: Path, compression: str, force: bool, as_json: bool) -> int:
    from pfcli.cli.printing import emit, lost
    from pfcli.events import Landmarks
    from pfcli.formats import landmark_csv
    from pfcli.formats.log_writer import LogWriter

    csv = target.with_name(f"{target.stem}-landmarks.csv")
    check_file(csv, force=force)
    with LogWriter(target, compression) as out:
        for event in log.events:
            out.event(event)
    landmark_csv.write(csv, log.places)
    seen = sum(len(event.ids) for event in log.events if isinstance(event, Landmarks))
    found = {"out": str(target), "landmarks": str(csv), "detections": seen, "robots": log.robots}
    found |= {"unknown_codes": log.unknown, "unreadable_lines": log.broken}
    line = f"{target}: {seen} detections of landmarks; {log.robots} of robots, {log.unknown} of unknown codes left out"
    emit(found, [line], as_json)
    return lost({"unreadable line": log.broken} if log.broken else {}, [])


def _frame(frame: "Frame", target: Path, compression: str, as_json: bool) -> int:
    from pfcli.cli.printing import emit
    from pfcli.events import LinePoints
    from pfcli.formats.log_writer import LogWriter

    points = next(event.points_m.shape[0] for event in frame.events if isinstance(event, LinePoints))
    with LogWriter(target, compression) as out:
        for event in frame.events:
            out.event(event)
    emit({"out": str(target), "points": points}, [f"{target}: one frame of {points} line points"], as_json)
    return 0


def _scaled(scan: "Scan", ranges: tuple[float, float | None]) -> "Scan":
    """Ranges by `--range-scale`, the usable range by `--range-max`, else scaled as well."""
    scale, top = ranges
    return scan._replace(
        ranges_m=(scan.ranges_m * scale).astype("float32"),
        range_min_m=scan.range_min_m * scale,
        range_max_m=top or scan.range_max_m * scale,
    )


def _carmen(
    source: Path, target: Path, ranges: tuple[float, float | None], repair: bool, compression: str
) -> dict[str, Any]:
    from pfcli.events import Pose2
    from pfcli.formats import carmen
    from pfcli.formats.log_writer import LogWriter

    records, broken = carmen.read(source)
    stamps, repaired = carmen.stamps_ns([r.stamp for r in records], repair=repair)
    backward = sum(b < a for a, b in itertools.pairwise(stamps))
    scale, range_max = ranges
    top = range_max / scale if range_max else carmen.usable_range_m(records)
    mounts = {r.mount for r in records if r.ranges_m is not None}
    scans = 0
    with LogWriter(target, compression) as log:
        mount = max(mounts, key=lambda m: sum(r.mount == m for r in records)) if mounts else Pose2()
        log.tf_static(min(stamps), [("base_link", "laser", mount)])
        for text, odometry, scan in carmen.events(records, stamps, top if math.isfinite(top) else 100.0):
            log.odometry(odometry)
            if scan is not None:
                log.source_stamp(scan.stamp_ns, text)
                log.scan(_scaled(scan, ranges))
                scans += 1
    notes = [f"{source}: {backward} stamps go back in time"] if backward else []
    return {
        "out": str(target),
        "scans": scans,
        "odometry": len(records),
        "range_max_m": round(top * scale, 6) if math.isfinite(top) else None,
        "repaired_stamps": repaired,
        "backward_steps": backward,
        "unreadable_lines": broken,
        "notes": notes,
    }
