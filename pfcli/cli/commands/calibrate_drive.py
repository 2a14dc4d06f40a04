"""`pfcli calibrate-drive LOG`."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pfcli.cli.drive_options import drive_of, drive_toml
from pfcli.cli.options import reading_options, settings_of
from pfcli.errors import LogError, UsageError
from pfcli.formats.atomic import check_file, output_file

if TYPE_CHECKING:
    from pfcli.core.motion.drive_calibration import Calibrated
    from pfcli.replay.settings import Drive

_KEYS = (
    "wheel_radius_left_m",
    "wheel_radius_right_m",
    "track_width_m",
    "sensor_x_m",
    "sensor_y_m",
    "sensor_yaw_deg",
    "offset_s",
)


@click.command("calibrate-drive")
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Where the wheels go, as TOML for --drive.")
@click.option("--truth", "by_truth", is_flag=True, help="Use the log's truth topic in place of its scans.")
@click.option("--force", is_flag=True, help="Replace OUT.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON object.")
@reading_options
def calibrate_drive(log: Path, out: Path | None, by_truth: bool, force: bool, as_json: bool, **given: Any) -> None:
    """Wheel radii, track width, place and clock of the scanner from any drive of LOG, without truth.

    How the scanner moved, by its scans, against how the two wheels of a differential drive say the robot moved (Censi 2013).
    Give the wheels and the mount as far as they are known; what the drive does not tell is said and left as given.

    Example: pfcli calibrate-drive log.mcap --wheel-radius-m 0.1 --track-width-m 0.35 --out drive.toml
    """
    if out is not None:
        check_file(out, force=force)
    from pfcli.cli.printing import emit
    from pfcli.replay.log import Log

    drive = drive_of(given)
    if drive.base != "differential":
        raise UsageError(f"calibrate-drive: a {drive.base} base has other wheels; calibrate-omni is for those")
    opened = Log(log, settings_of(given))
    motion = "encoders" if opened.choose("encoders") else "odometry"
    track = drive.track_m if motion == "encoders" else drive.track_m or 1.0
    found, radii, pairs = _calibrated(opened, motion, drive, track, by_truth)
    values = _values(found, radii, track, pairs, motion)
    if out is not None and motion == "encoders":
        named = drive._replace(radius_m=tuple(values[k] for k in _KEYS[:2]), track_m=values[_KEYS[2]])
        with output_file(out) as partial:
            partial.write_text(drive_toml(named))
    emit({"log": str(log), **values}, _lines(values, motion), as_json)


def _calibrated(
    opened: Any, motion: str, drive: "Drive", track: float, by_truth: bool
) -> tuple["Calibrated", tuple[float, float], int]:
    """What the drive tells, the radii that were given (1, 1 where odometry is scaled), and how many motions told it."""
    import numpy as np

    from pfcli.core.motion import drive_calibration
    from pfcli.replay import drive_record

    role = "truth" if by_truth else "scan"
    if opened.choose(role) is None:
        way = "--topic truth=TOPIC" if by_truth else "--topic scan=TOPIC, or --truth"
        raise UsageError(f"{opened.path}: calibrate-drive needs {'truth' if by_truth else 'laser scans'}; {way}")
    drive_ = drive_record.record(opened, motion, drive, (role,))
    if drive_.motion_s.size < 2:
        raise LogError(f"{opened.path}: holds no motion that can be read; calibrate-drive needs encoders or odometry")
    motions = drive_record.true_motions(drive_) if by_truth else drive_record.motions_of(drive_, drive_.mount)
    rolled = drive_.rolled
    if motion != "encoders":
        rolled = drive_record.rolled_by(drive_.odometry, track)
    start = np.array([1.0, 1.0, 1.0, *drive_.mount, 0.0])
    found = drive_calibration.calibrate(motions, drive_calibration.Rolling(drive_.motion_s, rolled, track), start)
    if found is None:
        raise LogError(
            f"{opened.path}: the robot hardly moves, or its scans do not fit each other; a longer drive is needed"
        )
    radii = drive.radius_m * 2 if len(drive.radius_m) == 1 else drive.radius_m or (1.0, 1.0)
    return found, (radii[0], radii[1]), motions.start_s.size


def _values(found: "Calibrated", radii: tuple[float, float], track: float, pairs: int, motion: str) -> dict[str, Any]:
    scales = (*radii, track, 1.0, 1.0, 180 / math.pi, 1.0)
    names = _KEYS if motion == "encoders" else ("scale_left", "scale_right", "scale_track", *_KEYS[3:])
    if motion != "encoders":
        scales = (1.0, 1.0, 1.0, *scales[3:])
    rows = zip(names, found.value.tolist(), found.sd.tolist(), found.told.tolist(), scales, strict=True)
    values: dict[str, Any] = {}
    for name, value, sd, told, scale in rows:
        values[name] = round(value * scale, 5)
        values[f"{name}_sd"] = round(sd * scale, 5) if told else None
    return values | {"motions": pairs, "spread_m": round(float(found.spread[0]), 5)}


def _lines(values: dict[str, Any], motion: str) -> list[str]:
    names = [k for k in values if f"{k}_sd" in values]
    lines = []
    for name in names:
        sd = values[f"{name}_sd"]
        lines.append(
            f"{name}: {values[name]:.5g}"
            + (f" +- {sd:.2g}" if sd is not None else " (the drive does not tell; as given)")
        )
    source = "the wheels" if motion == "encoders" else "the odometry, taken for two wheels"
    return [
        *lines,
        f"by {values['motions']} motions of the sensor against {source}, which differ by {values['spread_m']} m",
    ]
