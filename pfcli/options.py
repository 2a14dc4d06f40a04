"""From parameter dataclasses to click options, TOML files and documentation rows."""

import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from pfcli.align import SOURCES, Drive
from pfcli.errors import LogError, UsageError, reason
from pfcli.formats.messages import ROLES
from pfcli.initial import Initial, parse
from pfcli.params import build, fields
from pfcli.replay import Settings

_Command = Callable[..., Any]


class Finite(click.FloatRange):
    """A number within limits; NaN is none."""

    name = "float"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Raises click's usage error for NaN and infinity."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


def system_options(params: type) -> Callable[[_Command], _Command]:
    """One click option per parameter; None where the flag is not given, so that TOML and defaults show through."""

    def add(command: _Command) -> _Command:
        for field in reversed(fields(params)):
            note = f"{field.opt.help} [{field.opt.unit}]" if field.opt.unit else field.opt.help
            shown = f"{note}  (default: {str(field.default).lower() if field.kind is bool else field.default})"
            if field.kind is bool:
                declared = f"{field.flag}/--no-{field.flag[2:]}"
                command = click.option(declared, field.name, default=None, help=shown)(command)
            else:
                kind: Any = click.Choice(field.opt.choices) if field.opt.choices else field.kind
                command = click.option(field.flag, field.name, type=kind, default=None, help=shown)(command)
        return command

    return add


def build_params(params: type, given: dict[str, Any], file: Path | None) -> Any:
    """Flag over TOML over default. Raises UsageError naming the flag or the file's field."""
    names = {field.name for field in fields(params)}
    values: dict[str, Any] = {}
    if file is not None:
        try:
            values = tomllib.loads(file.read_text())
        except (OSError, UnicodeDecodeError) as error:
            raise LogError(f"--params {file}: cannot be read ({reason(error)})") from None
        except tomllib.TOMLDecodeError as error:
            raise UsageError(f"--params {file}: is not TOML ({reason(error)})") from None
        build(params, values, f"--params {file}")
    values |= {name: value for name, value in given.items() if name in names and value is not None}
    return build(params, values, "parameters")


def pairs(flags: tuple[str, ...], flag: str, keys: tuple[str, ...]) -> dict[str, str]:
    """`key=value` flags as a mapping. Raises UsageError for unknown keys and repeated ones."""
    found: dict[str, str] = {}
    for text in flags:
        key, _, value = text.partition("=")
        if not value or key not in keys:
            raise UsageError(f"{flag} {text}: expected NAME=VALUE with NAME one of {', '.join(keys)}")
        if key in found:
            raise UsageError(f"{flag} {text}: {key} is given twice")
        found[key] = value
    return found


def settings_of(
    topic: tuple[str, ...],
    clock: str,
    start: float | None,
    end: float | None,
    reorder: float,
    time_offset: tuple[str, ...],
    extrinsic: tuple[str, ...],
) -> Settings:
    """Reading options as Settings."""
    roles = tuple(ROLES)
    offsets = {}
    for role, text in pairs(time_offset, "--time-offset", roles).items():
        try:
            offsets[role] = float(text)
        except ValueError:
            raise UsageError(f"--time-offset {role}={text}: expected seconds") from None
    if start is not None and end is not None and end <= start:
        raise UsageError(f"--end {end:g} must be later than --start {start:g}")
    return Settings(pairs(topic, "--topic", roles), clock, start, end, reorder, offsets, extrinsic)


def drive_of(wheel_joints: str | None, radius: tuple[float, ...], track: float) -> Drive:
    """Wheel options as a Drive; one radius serves both wheels."""
    joints = None
    if wheel_joints is not None:
        parts = [p.strip() for p in wheel_joints.split(",")]
        if len(parts) != 2 or not all(parts):
            raise UsageError(f"--wheel-joints {wheel_joints}: expected LEFT,RIGHT")
        joints = (parts[0], parts[1])
    left, right = (radius[0], radius[-1]) if radius else (0.0, 0.0)
    return Drive(joints, left, right, track)


def localiser_options(wanted: bool) -> Callable[[_Command], _Command]:
    """Options of the systems that localise in a map."""

    def add(command: _Command) -> _Command:
        if not wanted:
            return command
        for option in (
            click.option(
                "--heading-prior", metavar="YAW[,SD]", default=None, help="Heading at the start and its spread (rad)."
            ),
            click.option(
                "--initial",
                metavar="START",
                default="unknown",
                show_default=True,
                help="unknown, inside, outside, X,Y,YAW[,SDX,SDY,SDYAW] or region:MAP.yaml.",
            ),
            click.option(
                "--map", "map_file", type=click.Path(path_type=Path), required=True, help="Map YAML to localise in."
            ),
        ):
            command = option(command)
        return command

    return add


def initial_of(given: dict[str, Any]) -> Initial:
    """Start of a localiser; systems without a map have none."""
    return parse(given["initial"], given["heading_prior"]) if "initial" in given else Initial()


def reading_options(command: _Command) -> _Command:
    """Options of every command that replays a log."""
    role_list = ", ".join(ROLES)
    for option in reversed(
        (
            click.option(
                "--topic",
                multiple=True,
                metavar="ROLE=TOPIC",
                help=f"Which topic plays a role ({role_list}); odometry=/tf:odom.base_link reads transforms.",
            ),
            click.option(
                "--time",
                "clock",
                type=click.Choice(["header", "log", "publish"]),
                default="header",
                show_default=True,
                help="Which stamp of a message counts.",
            ),
            click.option(
                "--start",
                type=Finite(0),
                default=None,
                help="Begin so many seconds after the log's first stamp [s].",
            ),
            click.option(
                "--end",
                type=Finite(0),
                default=None,
                help="Stop so many seconds after the log's first stamp [s].",
            ),
            click.option(
                "--reorder",
                type=Finite(0, 3600),
                default=2.0,
                show_default=True,
                help="Messages may arrive so much too late [s].",
            ),
            click.option(
                "--time-offset",
                multiple=True,
                metavar="ROLE=S",
                help="Add seconds to the stamps of a role, such as scan=-0.03.",
            ),
            click.option(
                "--extrinsic",
                multiple=True,
                metavar="PARENT:CHILD=X,Y,YAW",
                help="Where a sensor sits (m, m, rad), over /tf_static.",
            ),
            click.option(
                "--motion",
                type=click.Choice(SOURCES),
                default="auto",
                show_default=True,
                help="Where motion comes from.",
            ),
            click.option("--wheel-joints", metavar="LEFT,RIGHT", default=None, help="Joints of the driven wheels."),
            click.option(
                "--wheel-radius-m",
                type=Finite(0, 100),
                multiple=True,
                help="Wheel radius; twice for left and right [m].",
            ),
            click.option("--track-width-m", type=Finite(0, 100), default=0.0, help="Distance between the wheels [m]."),
        )
    ):
        command = option(command)
    return command
