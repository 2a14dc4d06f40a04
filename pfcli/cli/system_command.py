"""The command of a system: replay logs through it and write the results."""

import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pfcli import registry
from pfcli.batches.worker import CommandLine, Flag
from pfcli.cli.drive_options import drive_of
from pfcli.cli.help_pages import SystemCommand, help_all_option
from pfcli.cli.options import (
    build_params,
    chosen,
    finding_options,
    initial_of,
    localiser_options,
    reading_options,
    sensor_options,
    settings_of,
    system_options,
)
from pfcli.cli.types import Readable
from pfcli.errors import UsageError
from pfcli.formats.atomic import check, check_picture, interrupt_on_terminate, output_dir

if TYPE_CHECKING:
    from pfcli.runs.loop import Job


@cache
def command(name: str) -> click.Command:
    """The click command of the system `name`; its kernels are imported only when it runs."""
    system = registry.system(name)
    logs = "LOGS: MCAP files in order of time; `-`: standard input."
    usage = f"Example: pfcli {name} log.mcap{' --map map.yaml' if system.map else ''} --out out/run"

    @click.command(name, cls=SystemCommand, help="\n\n".join((system.summary, logs, usage)))
    @click.argument("logs", nargs=-1, required=True, type=Readable())
    @click.option("--out", "out", required=True, type=click.Path(path_type=Path), help="Folder for the results.")
    @click.option("--force", is_flag=True, help="Replace a folder that is not empty.")
    @click.option(
        "--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True, help="Seed of all random draws."
    )
    @click.option("--params", "params_file", type=click.Path(path_type=Path), help="Parameters from a TOML file.")
    @click.option(
        "--truth",
        default=None,
        metavar="auto|TOPIC|FILE",
        help="Add error columns against a truth topic or a file (TUM, EuRoC, KITTI, CSV).",
    )
    @click.option(
        "--overlay", is_flag=True, help="Also write overlay.mcap: poses, particles and map, to open beside the log."
    )
    @click.option("--report", is_flag=True, help="Also write report.html: a page to look at, with no other file.")
    @click.option(
        "--plot",
        type=click.Path(path_type=Path),
        default=None,
        help="Also draw map and track into this PNG, SVG or PDF.",
    )
    @click.option(
        "--animate",
        type=click.Path(path_type=Path),
        default=None,
        help="Also film the filter at work: GIF, or MP4 where ffmpeg is installed; PNG, SVG or PDF: eight instants.",
    )
    @click.option(
        "--threads", type=click.IntRange(0, 1024), default=0, help="Threads of the kernels (default: all cores)."
    )
    @click.option(
        "--progress", "progress_mode", type=click.Choice(["auto", "never", "json"]), default="auto", show_default=True
    )
    @click.option("--json", "as_json", is_flag=True, help="Print the summary as one JSON object.")
    @click.option("-q", "--quiet", is_flag=True, help="Say nothing but errors.")
    @finding_options
    @help_all_option
    @reading_options
    @sensor_options(system)
    @localiser_options(system)
    @system_options(system)
    def system_command(**given: Any) -> int:
        return _run(name, given)

    return system_command


def job_of(name: str, given: dict[str, Any]) -> "Job":
    """The job that the command `name` with these options runs."""
    system = chosen(registry.system(name), given)
    built = build_params(system.params, given, given["params_file"])
    settings = settings_of(given)

    from pfcli.runs import loop

    return loop.Job(
        system,
        built,
        given["logs"],
        given["seed"],
        settings,
        given["motion"],
        drive_of(given),
        given["truth"],
        given["threads"],
        "never" if given["quiet"] else given["progress_mode"],
        given.get("map_file"),
        initial_of(given),
        ignore=given["ignore"],
    )


def parsed(name: str, words: Sequence[str]) -> "Job":
    """The job of `pfcli NAME WORDS`. Raises UsageError where that would be refused."""
    try:
        with command(name).make_context(f"pfcli {name}", list(words)) as context:
            return job_of(name, context.params)
    except click.ClickException as error:
        raise UsageError(f"{name}: {error.format_message()}") from None


def flags(name: str) -> dict[str, Flag]:
    """The flags of `pfcli NAME`."""
    return {
        flag: Flag(bool(getattr(option, "multiple", False)), bool(option.secondary_opts))
        for option in command(name).params
        for flag in option.opts
    }


COMMAND_LINE = CommandLine(parsed, flags)
"""What batches read the words of their jobs by."""


def _run(name: str, given: dict[str, Any]) -> int:
    check(given["out"], force=given["force"])
    if given["plot"] is not None:
        check_picture(given["plot"])
    if given["animate"] is not None:
        from pfcli.reports import animation

        animation.check(given["animate"])
    interrupt_on_terminate()
    job = job_of(name, given)._replace(command=("pfcli", *sys.argv[1:]))

    from pfcli.cli.printing import compiling, emit, tell
    from pfcli.runs import loop, results

    with compiling(given["quiet"]) as say:
        done = loop.execute(job._replace(say=say))
    with output_dir(given["out"], force=given["force"]) as folder:
        summary = results.write(folder, job, done)
        if given["overlay"]:
            from pfcli.reports import overlay

            overlay.write(folder / "overlay.mcap", done.result)
        if given["report"]:
            from pfcli.reports import page

            page.write(folder, folder / "report.html")
        if given["plot"] is not None:
            from pfcli.reports import run_picture

            run_picture.write(given["plot"], job, done)
        if given["animate"] is not None:
            animation.animate(given["animate"], done.result, job.system.name)
    lines = [] if given["quiet"] else _lines(summary, given["out"], job.system.readings)
    emit(summary | {"out": str(given["out"])}, lines, given["as_json"])
    return tell(done.findings, summary["lost"], quiet=given["quiet"], strict=given["strict"])


def _lines(summary: dict[str, Any], out: Path, readings: str) -> list[str]:
    seconds = summary["seconds"]
    lines = [
        f"{out}: {summary['scans']} {readings} over {summary['span_s']:.1f} s and {summary['way_m']:.1f} m,"
        f" {summary['updates']} updates in {seconds['loop']:.2f} s ({summary['ms_per_update']:.2f} ms each)"
    ]
    if summary.get("verdict"):
        why = "; ".join(summary["verdict"]["why"])
        lines.append(f"verdict: {summary['verdict']['grade']}" + (f" ({why})" if why else ""))
    if summary["last_pose"] is not None:
        last = summary["last_pose"]
        where = f"x {last['x_m']:.3f} m, y {last['y_m']:.3f} m, yaw {last['yaw_rad']:.4f} rad"
        lines.append(f"last pose, after {last['after_s']:.1f} s: {where}")
    if "truth" in summary:
        t = summary["truth"]
        lines.append(
            f"against truth: ATE {t['ate_m']:.4f} m, mean {t['mean_m']:.4f} m, max {t['max_m']:.4f} m,"
            + (" no heading" if t["heading_rmse_deg"] is None else f" heading {t['heading_rmse_deg']:.3f} deg")
        )
    return lines
