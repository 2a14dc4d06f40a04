"""From parameter dataclasses to click options, TOML files and documentation rows."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from pfcli.cli.drive_options import wheel_options
from pfcli.cli.types import Finite, max_chunk_option, max_map_option, unknown_grey_option
from pfcli.cli.vision_options import image_of, vision_options
from pfcli.errors import UsageError
from pfcli.findings import CODES, known
from pfcli.formats.limits import DEFAULTS, Limits
from pfcli.formats.roles import ROLES
from pfcli.formats.toml_file import read_toml
from pfcli.initial import Initial, parse
from pfcli.params import Field, build, fields
from pfcli.replay import cuts
from pfcli.replay.settings import RANGES, SOURCES, STAMPS, Band, Deskew, Settings
from pfcli.systems.shared.contract import System

_Command = Callable[..., Any]
_FARTHEST_OFFSET_S = 2e9


def system_options(system: System) -> Callable[[_Command], _Command]:
    """One click option per parameter; None where the flag is not given, so that TOML and defaults show through.

    The parameters of variants behind a flag are options of the same command; shared names are one option.
    """
    own = fields(system.params)
    names = {field.name for field in own}
    variants = {flag: {field.name: field for field in fields(v.params)} for flag, v in system.variants.items()}
    extra = {
        name: (flag, field) for flag, more in variants.items() for name, field in more.items() if name not in names
    }

    def add(command: _Command) -> _Command:
        for flag, field in reversed(extra.values()):
            command = _option(field, f"--{flag}: {_note(field)}  (default: {_shown(field)})")(command)
        for field in reversed(own):
            others = [(flag, more[field.name]) for flag, more in variants.items() if field.name in more]
            both = "".join(f"; --{flag}: {other.default}" for flag, other in others if other.default != field.default)
            command = _option(field, f"{_note(field)}  (default: {_shown(field)}{both})")(command)
        for flag, variant in system.variants.items():
            command = click.option(f"--{flag}", flag, is_flag=True, help=variant.summary)(command)
        return command

    return add


def _note(field: Field) -> str:
    return f"{field.opt.help} [{field.opt.unit}]" if field.opt.unit else field.opt.help


def _shown(field: Field) -> str:
    return str(field.default).lower() if field.kind is bool else str(field.default)


def _option(field: Field, text: str) -> Callable[[_Command], _Command]:
    if field.kind is bool:
        return click.option(f"{field.flag}/--no-{field.flag[2:]}", field.name, default=None, help=text)
    kind: Any = click.Choice(field.opt.choices) if field.opt.choices else field.kind
    return click.option(field.flag, field.name, type=kind, default=None, help=text)


def chosen(system: System, given: dict[str, Any]) -> System:
    """The record that the flags of a command choose: the system's own, or that of a variant.

    Raises UsageError for an option that only another of them has, or for two variants."""
    flags = [flag for flag in system.variants if given.get(flag)]
    if len(flags) > 1:
        raise UsageError(f"--{flags[0]} and --{flags[1]} do not go together")
    found = system.variants[flags[0]] if flags else system
    names = {field.name for field in fields(found.params)}
    for flag, other in (("", system), *system.variants.items()):
        for field in fields(other.params):
            if field.name not in names and given.get(field.name) is not None:
                where = f"with --{flag}" if flag else f"without --{flags[0]}"
                raise UsageError(f"{field.flag} goes {where}")
    return found


def build_params(params: type, given: dict[str, Any], file: Path | None) -> Any:
    """Flag over TOML over default. Raises UsageError naming the flag or the file's field."""
    names = {field.name for field in fields(params)}
    values: dict[str, Any] = {}
    if file is not None:
        values = read_toml(file, "--params")
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


def settings_of(given: dict[str, Any]) -> Settings:
    """Reading options as Settings."""
    roles = tuple(ROLES)
    offsets = {}
    asked = pairs(given["time_offset"], "--time-offset", roles)
    estimate = asked.get("scan") == "auto" and bool(asked.pop("scan"))
    for role, text in asked.items():
        try:
            offsets[role] = float(text)
        except ValueError:
            offsets[role] = math.nan
        if not abs(offsets[role]) <= _FARTHEST_OFFSET_S:
            raise UsageError(f"--time-offset {role}={text}: expected seconds")
    start, end = given["start"], given["end"]
    if start is not None and end is not None and end <= start:
        raise UsageError(f"--end {end:g} must be later than --start {start:g}")
    topics = pairs(given["topic"], "--topic", roles)
    image = image_of(given.get("px_per_cm"), given.get("image_centre"))
    return Settings(
        topics,
        given["clock"],
        start,
        end,
        given["reorder"],
        offsets,
        given["extrinsic"],
        image,
        given.get("landmark_ranges", RANGES[0]),
        Limits(given["max_chunk_mib"], given["max_buffer_mib"], given.get("max_map_mpx", DEFAULTS.map_mpx)),
        base_frame=given["base_frame"],
        robot=given["robot"],
        band=band_of(given["slice_m"]),
        deskew=Deskew(given["deskew"], given["scan_duration"], given["scan_stamp"]),
        estimate_offset=estimate,
        truth_lever_m=lever_of(given["truth_lever"]),
        unknown_grey=given.get("unknown_grey"),
        cuts=cuts.parse(given["cut"]),
    )


def lever_of(text: str | None) -> tuple[float, float]:
    """Place of `--truth-lever X,Y` (m)."""
    if text is None:
        return 0.0, 0.0
    try:
        x, y = (float(v) for v in text.split(","))
        if not math.isfinite(x + y):
            raise ValueError
    except ValueError:
        raise UsageError(f"--truth-lever {text}: expected X,Y (m), such as 0.2,-0.1") from None
    return x, y


def band_of(text: str | None) -> Band | None:
    """Heights of `--slice-m LOW,HIGH` (m)."""
    if text is None:
        return None
    try:
        low, high = (float(v) for v in text.split(","))
        if not -math.inf < low < high < math.inf:
            raise ValueError
    except ValueError:
        raise UsageError(f"--slice-m {text}: expected LOW,HIGH (m), such as 0.1,2.0") from None
    return Band(low, high)


def localiser_options(system: System) -> Callable[[_Command], _Command]:
    """Options of the systems that localise in a given frame: where they start, and the map if they need one."""

    def add(command: _Command) -> _Command:
        if system.frame != "given":
            return command
        if system.map:
            command = click.option(
                "--map", "map_file", type=click.Path(path_type=Path), required=True, help="Map YAML to localise in."
            )(max_map_option(unknown_grey_option(command)))
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
        ):
            command = option(command)
        return command

    return add


def sensor_options(system: System) -> Callable[[_Command], _Command]:
    """Options of the sensors that a system, or one of its variants, can use."""
    kinds = {kind for record in (system, *system.variants.values()) for need in record.needs for kind in need}
    return vision_options if kinds & {"lines", "landmarks"} else lambda command: command


def initial_of(given: dict[str, Any]) -> Initial:
    """Start of a localiser; systems without a map have none."""
    return parse(given["initial"], given["heading_prior"]) if "initial" in given else Initial()


def finding_options(command: _Command) -> _Command:
    """Options of every command that judges what it read."""
    command = click.option(
        "--strict", is_flag=True, help="Exit code 4 instead of 3 where a finding says loss or doubt."
    )(command)
    return click.option(
        "--ignore",
        multiple=True,
        metavar="CODE",
        callback=_codes,
        help="Silence the finding with this code, such as W106 (docs/checks.md has them all).",
    )(command)


def _codes(context: click.Context, option: click.Parameter, words: tuple[str, ...]) -> tuple[str, ...]:
    for word in words:
        if not known(word):
            raise UsageError(f"--ignore {word}: no finding has this code; known: {', '.join(CODES)}")
    return words


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
                "--cut",
                multiple=True,
                metavar="FROM,TO",
                help="Leave these seconds out as if the robot had been off and carried; repeatable [s].",
            ),
            click.option(
                "--reorder",
                type=Finite(0, 3600),
                default=2.0,
                show_default=True,
                help="Messages may arrive so much too late [s].",
            ),
            max_chunk_option,
            click.option(
                "--max-buffer-mib",
                type=Finite(0, 1 << 20, min_open=True),
                default=DEFAULTS.buffer_mib,
                show_default=True,
                help="Messages that may wait within --reorder of one stamp [MiB].",
            ),
            click.option(
                "--time-offset",
                multiple=True,
                metavar="ROLE=S",
                help="Add seconds to the stamps of a role, such as scan=-0.03; scan=auto finds them by the turns.",
            ),
            click.option(
                "--extrinsic",
                multiple=True,
                metavar="PARENT:CHILD=X,Y,YAW",
                help="Where a sensor sits (m, m, rad), over /tf_static; or X,Y,Z,ROLL,PITCH,YAW.",
            ),
            click.option(
                "--base-frame",
                metavar="FRAME",
                default="",
                help="The robot's base frame.  (default: the child of the odometry, or what that sits on)",
            ),
            click.option(
                "--robot", metavar="NAME", default="", help="Namespace of the robot, where a log holds several."
            ),
            click.option(
                "--truth-lever",
                metavar="X,Y",
                default=None,
                help="Where on the robot the point sits whose positions are the truth, such as an antenna [m].",
            ),
            click.option(
                "--slice-m",
                metavar="LOW,HIGH",
                default=None,
                help="Heights above the floor between which things are walls, for point clouds and scanners that"
                " lean [m].  (default: 0.1,2.0; of a scanner that leans up to the ceiling, where one shows)",
            ),
            click.option(
                "--deskew/--no-deskew",
                default=True,
                help="Place each beam by the motion at its own time, where the log tells it.  (default: on)",
            ),
            click.option(
                "--scan-duration",
                type=Finite(0, 1),
                default=None,
                help="From the first beam of a scan to the last [s].  (default: the log's time_increment)",
            ),
            click.option(
                "--scan-stamp",
                type=click.Choice(STAMPS),
                default=STAMPS[0],
                show_default=True,
                help="Which beam a scan's stamp is of.",
            ),
            click.option(
                "--motion",
                type=click.Choice(SOURCES),
                default="auto",
                show_default=True,
                help="Where motion comes from.",
            ),
        )
    ):
        command = option(command)
    return wheel_options(command)
