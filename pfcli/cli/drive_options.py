"""Command-line options and files that describe the wheels of a robot."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from pfcli.cli.types import Finite
from pfcli.errors import UsageError
from pfcli.formats.toml_file import read_toml
from pfcli.replay.settings import BASES, Drive

_DRIVE_FILE = {
    "base": "base",
    "wheel_joints": "joints",
    "wheel_radius_m": "radius_m",
    "track_width_m": "track_m",
    "axle_distance_m": "axles_m",
    "wheel_arm_m": "arm_m",
    "wheel_angle_deg": "angle_deg",
    "joint_ticks_per_turn": "ticks_per_turn",
}
"""Name of a wheel flag, and of the field in a `--drive` file -> field of Drive."""


def drive_of(given: dict[str, Any]) -> Drive:
    """Wheel options as a Drive: flag over `--drive` file over default."""
    values = _drive_file(given["drive_file"]) if given["drive_file"] is not None else {}
    for flag, field in _DRIVE_FILE.items():
        value = given[flag]
        if flag == "wheel_joints" and value is not None:
            value = tuple(p.strip() for p in value.split(","))
            if len(value) < 2 or not all(value):
                raise UsageError(f"--wheel-joints {given[flag]}: expected the names of the wheels, such as LEFT,RIGHT")
        if value not in (None, ()):
            values[field] = value
    return Drive(**values)


def drive_toml(drive: Drive) -> str:
    """A Drive as a `--drive` file."""
    lines = ["# the wheels of a robot, for --drive"]
    for flag, field in _DRIVE_FILE.items():
        value = getattr(drive, field)
        if value in (None, (), 0.0):
            continue
        items = [
            f'"{v}"' if isinstance(v, str) else repr(round(v, 6))
            for v in (value if isinstance(value, tuple) else (value,))
        ]
        lines.append(f"{flag} = " + (f"[{', '.join(items)}]" if isinstance(value, tuple) else items[0]))
    return "\n".join(lines) + "\n"


def _drive_file(path: Path) -> dict[str, Any]:
    """Fields of a TOML file as `pfcli calibrate-omni` writes it."""
    values: dict[str, Any] = {}
    for name, value in read_toml(path, "--drive").items():
        listed = name in ("wheel_joints", "wheel_radius_m", "wheel_angle_deg")
        items = value if isinstance(value, list) else [value]
        kind = str if name in ("base", "wheel_joints") else (int, float)
        good = all(isinstance(v, kind) and not isinstance(v, bool) for v in items) and listed == isinstance(value, list)
        good = good and all(math.isfinite(v) for v in items if isinstance(v, int | float))
        if name not in _DRIVE_FILE or not good or (name == "base" and value not in BASES):
            raise UsageError(
                f"--drive {path}: field {name!r} is unknown or has no legal value; known: {', '.join(_DRIVE_FILE)}"
            )
        values[_DRIVE_FILE[name]] = tuple(items) if listed else value
    return values


def wheel_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options of every command that may roll on wheels."""
    for option in reversed(
        (
            click.option(
                "--base",
                type=click.Choice(BASES),
                default=None,
                help="What the wheels are: left and right, omni wheels, mecanum wheels.  (default: differential)",
            ),
            click.option(
                "--wheel-joints",
                metavar="NAMES",
                default=None,
                help="Joints of the wheels, in order, such as LEFT,RIGHT.",
            ),
            click.option(
                "--wheel-radius-m", type=Finite(0, 100), multiple=True, help="Wheel radius; or once for each wheel [m]."
            ),
            click.option(
                "--track-width-m", type=Finite(0, 100), default=None, help="Distance of left and right wheels [m]."
            ),
            click.option(
                "--axle-distance-m",
                type=Finite(0, 100),
                default=None,
                help="Distance of front and rear axle [m]: of a mecanum base, or of a car that is steered.",
            ),
            click.option(
                "--wheel-arm-m", type=Finite(0, 100), default=None, help="Omni: from the centre to a wheel [m]."
            ),
            click.option(
                "--wheel-angle-deg",
                type=Finite(-360, 360),
                multiple=True,
                help="Omni: phi of four wheels at 90 + phi, 90 - phi, phi - 90, -phi - 90; or once for each wheel [deg].",
            ),
            click.option(
                "--joint-ticks-per-turn",
                type=Finite(0, 1e9),
                default=None,
                help="JointState.position counts ticks: so many make a turn.",
            ),
            click.option(
                "--drive",
                "drive_file",
                type=click.Path(path_type=Path),
                help="TOML with these options, from calibrate-omni.",
            ),
        )
    ):
        command = option(command)
    return command
