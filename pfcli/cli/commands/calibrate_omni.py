"""`pfcli calibrate-omni LOG...`."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pfcli.cli.drive_options import drive_of, drive_toml
from pfcli.cli.options import reading_options, settings_of
from pfcli.cli.types import Readable
from pfcli.cli.vision_options import vision_options
from pfcli.errors import LogError, UsageError

if TYPE_CHECKING:
    from pfcli.dropped import Dropped
    from pfcli.replay.log import Log
    from pfcli.replay.settings import Drive
    from pfcli.systems.fuse_soccer.base_calibration import Fit, Rolled, Spread

_LEAST_ROWS = 50


@click.command("calibrate-omni")
@click.argument("logs", nargs=-1, required=True, type=Readable())
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for drive.toml and params.toml.")
@click.option(
    "--test", "tests", multiple=True, type=click.Path(path_type=Path), help="Log to judge the result by; repeatable."
)
@click.option("--field", default="msl-18x12", show_default=True, help="Field whose lines the points are on.")
@click.option("--force", is_flag=True, help="Replace a folder that is not empty.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON object.")
@reading_options
@vision_options
def calibrate_omni(
    logs: tuple[Path, ...], out: Path, tests: tuple[Path, ...], field: str, force: bool, as_json: bool, **given: Any
) -> int:
    """Measure a robot's wheels and its vision from LOGS with truth.

    Give the wheels' measures as they are believed to be: radii, arm, angles (omni), track and axle distance (mecanum), and
    the result stays near them where the logs say little. Points of field lines, where a log has them, give their spread by
    range and its histograms (histograms.parquet).

    Example: pfcli calibrate-omni log.mcap --base omni --wheel-radius-m 0.06 --wheel-arm-m 0.2 --wheel-angle-deg 45 --out cal
    """
    from pfcli.formats.atomic import check, output_dir

    settings, drive = settings_of(given), drive_of(given)
    drive.jacobian()
    check(out, force=force)

    from pfcli.cli.printing import emit, lost
    from pfcli.dropped import Dropped
    from pfcli.formats import parquet
    from pfcli.replay.log import Log
    from pfcli.systems.fuse_soccer import base_calibration

    dropped = Dropped()
    opened = [Log(path, settings) for path in logs]
    runs = [rolled_of_log(log, drive, dropped) for log in opened]
    fit, before = base_calibration.fit_wheels(runs, drive), base_calibration.Fit(drive, (0.0, 0.0, 0.0))
    judged = [(str(path), rolled_of_log(Log(path, settings), drive, dropped)) for path in tests]
    judged = judged or [(str(path), run) for path, run in zip(logs, runs, strict=True)]
    errors = {
        name: {
            key: round(value, 4)
            for which, measures in (("before", before), ("after", fit))
            for key, value in zip(
                (f"{which}_mean_m", f"{which}_max_m"), base_calibration.error_m(run, measures), strict=True
            )
        }
        for name, run in judged
    }
    spread = _spread(opened, runs, fit, field)
    with output_dir(out, force=force) as folder:
        (folder / "drive.toml").write_text(drive_toml(fit.drive))
        if spread is not None:
            hit = float((spread.hit * spread.points).sum() / spread.points.sum())
            text = f'sigma = "{base_calibration.sigma_text(spread)}"\nhit = {hit:.4f}\n'
            (folder / "params.toml").write_text("# of line points, by calibrate-omni\n" + text)
            columns = spread._asdict() | {"histogram": list(spread.histogram)}
            parquet.write(folder / "histograms.parquet", columns, {"bin_m": base_calibration.REACH_M / 40})
    values = {
        "out": str(out),
        "drive": {k: v for k, v in fit.drive._asdict().items() if v not in (None, (), 0.0)},
        "tracked_body_at": [round(v, 4) for v in fit.mount],
        "dead_reckoning": errors,
    }
    if spread is not None:
        values["sigma"] = base_calibration.sigma_text(spread)
    lines = [
        f"{name}: dead reckoning off by {e['before_mean_m']:.3f} m on the average before,"
        f" {e['after_mean_m']:.3f} m after (maximum {e['after_max_m']:.3f} m)"
        for name, e in errors.items()
    ]
    points = ", params.toml" if spread is not None else "; no range has 50 points of lines, so no params.toml"
    emit(values, [f"{out}: drive.toml{points}", *lines], as_json)
    return lost(dropped.counts, dropped.notes)


def rolled_of_log(log: "Log", drive: "Drive", dropped: "Dropped") -> "Rolled":
    """Wheel angles and truth of a log; what is left out is counted. Raises UsageError or LogError naming what is missing."""
    import numpy as np

    from pfcli.events import Truth
    from pfcli.replay.dead_reckoning import DeadReckoning
    from pfcli.systems.fuse_soccer.base_calibration import rolled_of

    for role in ("encoders", "truth"):
        if log.choose(role) is None:
            raise UsageError(f"{log.path}: has no {role} topic; map one with --topic {role}=TOPIC")
    reckon = DeadReckoning("encoders", drive, dropped)
    rows, truth = [], []
    for event in log.events(["encoders", "truth"]):
        if isinstance(event, Truth):
            if all(map(math.isfinite, event[1:4])):
                truth.append(tuple(event))
            else:
                dropped.add("truth that is not a number", f"{log.path}: true poses that are not numbers are left out")
        elif reckon(event) is not None and reckon.rolled.size:
            rows.append((event.stamp_ns, reckon.rolled[0]))
    dropped.take(log.dropped)
    if len(rows) < _LEAST_ROWS or len(truth) < _LEAST_ROWS:
        raise LogError(
            f"{log.path}: holds {len(rows)} encoder readings and {len(truth)} true poses; {_LEAST_ROWS} of each are needed"
        )
    radius = np.broadcast_to(np.array(drive.radius_m), rows[0][1].size)
    angles = np.array([travel for _, travel in rows]) / radius
    stamps, true_ns = np.array([t for t, _ in rows], np.int64), np.array([t[0] for t in truth], np.int64)
    found = rolled_of(stamps, angles, true_ns, np.array([t[1:4] for t in truth], float))
    if found.seconds.size < _LEAST_ROWS:
        raise LogError(f"{log.path}: encoders and truth do not overlap in time; see --time-offset")
    return found


def _spread(logs: "list[Log]", runs: "list[Rolled]", fit: "Fit", field: str) -> "Spread | None":
    """How far the points of lines are from the lines, at the true poses; None where no range has points enough."""
    import numpy as np

    from pfcli.events import LinePoints
    from pfcli.formats import field_yaml
    from pfcli.systems.fuse_soccer.base_calibration import off_lines, spread_by_range

    found = []
    for log, run in zip(logs, runs, strict=True):
        if log.choose("lines") is not None:
            events = (e for e in log.events(["lines"]) if isinstance(e, LinePoints))
            seen = [((e.stamp_ns - run.begin_ns) * 1e-9, e.points_m) for e in events]
            found.append(off_lines(run, fit.mount, seen, field_yaml.read(field).lines))
    if not found:
        return None
    spread = spread_by_range(*(np.concatenate(part) for part in zip(*found, strict=True)))
    return spread if spread.points.size else None
