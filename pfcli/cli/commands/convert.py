"""`pfcli convert IN... OUT`."""

from pathlib import Path
from typing import Any

import click

from pfcli.cli.types import Finite, Readable, max_chunk_option, streamed
from pfcli.errors import UsageError
from pfcli.formats.atomic import check_file


@click.command()
@click.argument("sources", nargs=-1, required=True, type=Readable(), metavar="SOURCE...")
@click.argument("target", type=click.Path(path_type=Path))
@click.option(
    "--max-range-m",
    "--range-max",
    "max_range_m",
    type=Finite(0, 10_000, min_open=True),
    default=None,
    help="Usable range of the scanner [m]; default: just below what the log repeats where nothing returns.",
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
@max_chunk_option
@click.option("--force", is_flag=True, help="Replace TARGET.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as one JSON object.")
def convert(sources: tuple[Path, ...], target: Path, **given: Any) -> int:
    """Convert SOURCE, a recording of one part or more, to one MCAP log; TARGET `-`: to standard output.

    SOURCE: CARMEN .log/.clf, also .gz and .bz2; ROS 1 .bag; a rosbag2 folder, .db3 or MCAP parts; MRPT .rawlog; tinySLAM
    .dat, the folder of a LEGO robot, a tricycle's .txt or OptiOdom's .csv, whose wheel ticks stay ticks; a frame of field
    lines (Falcons' .json, Carpe Noctem's LinePoints.txt); landmarks (MR.CLAM's RobotN_Measurement.dat with the robot's other
    files beside it, Stachniss' sensor_data.dat). All of these are also read by the systems directly.

    Example: pfcli convert intel.clf.bz2 intel.mcap
    """
    with streamed(target) as place:
        return _written(sources, place, given)


def _written(sources: tuple[Path, ...], target: Path, given: dict[str, Any]) -> int:
    from pfcli.cli.printing import emit, lost, say
    from pfcli.formats import conversion, landmark_csv, landmark_logs
    from pfcli.formats.limits import Reading

    check_file(target, force=given["force"])
    if target.exists() and any(source.exists() and target.samefile(source) for source in sources):
        raise UsageError(f"{target}: is the log itself; name another file")
    csv = target.with_name(f"{target.stem}-landmarks.csv")
    if any(source.exists() and landmark_logs.reader_of(source) for source in sources):
        check_file(csv, force=given["force"])
    reading = Reading(
        max_chunk_mib=given["max_chunk_mib"],
        range_scale=given["range_scale"],
        max_range_m=given["max_range_m"],
        repair_stamps=given["repair_stamps"],
    )
    done = conversion.convert(sources, target, given["compression"], reading)
    found: dict[str, Any] = {"out": str(target), **done.facts}
    if done.places:
        landmark_csv.write(csv, done.places)
        found["landmarks"] = str(csv)
    line = done.line or f"{done.messages} messages, {done.extras} attachments and metadata"
    found |= {"messages": done.messages, "skipped": 0, "unknown_types": done.unknown}
    if done.unknown:
        kinds = ", ".join(f"{name} ({count})" for name, count in sorted(done.unknown.items()))
        line += f"; copied as they are, of types that pfcli does not read: {kinds}"
    for note in done.notes:
        say(note)
    emit(found, [f"{target}: {line}"], given["as_json"])
    lines = done.facts.get("unreadable_lines", 0)
    counts = {"unreadable line": lines} if lines else {"damaged place": len(done.losses)} if done.losses else {}
    return lost(counts, done.losses)
