"""The `pfcli` command: a lazy click group, nothing else."""

import difflib
import errno
import importlib
import sys
from typing import Any

import click

from pfcli import __version__
from pfcli.errors import EXIT_FAILED, EXIT_INTERRUPTED, PfcliError, UsageError, printable, reason
from pfcli.registry import systems, unusable

_COMMANDS = {
    "info": ("pfcli.cli.commands.info:info", "What a log holds, and which systems it can feed."),
    "check": ("pfcli.cli.commands.check:check", "What is wrong with a log: units, signs, clocks, mounts, losses."),
    "convert": ("pfcli.cli.commands.convert:convert", "CARMEN logs, ROS bags and logs of wheel ticks -> MCAP."),
    "repair": ("pfcli.cli.commands.repair:repair", "A damaged or odd MCAP log -> a clean, indexed one."),
    "simulate": ("pfcli.cli.commands.simulate:simulate", "Worlds, robots and sensors with truth -> MCAP."),
    "evaluate": ("pfcli.cli.commands.evaluate:evaluate", "A track against truth or relations; a map against itself."),
    "calibrate": ("pfcli.cli.commands.calibrate:calibrate", "What localize-reliable decides by, learnt from a map."),
    "calibrate-omni": (
        "pfcli.cli.commands.calibrate_omni:calibrate_omni",
        "A robot's wheels and the spread of its line points, from a log with truth.",
    ),
    "calibrate-drive": (
        "pfcli.cli.commands.calibrate_drive:calibrate_drive",
        "Wheel radii, track width, place and clock of the scanner, from any drive.",
    ),
    "report": ("pfcli.cli.commands.report:report", "A run as one HTML page: map, charts, a slider through its time."),
    "compare": ("pfcli.cli.commands.compare:compare", "Runs side by side: errors, times, tracks, and what differs."),
    "batch": ("pfcli.cli.commands.batch:batch", "Logs x systems x parameters x seeds, on all cores or a cluster."),
    "summarize": (
        "pfcli.cli.commands.summarize:summarize",
        "What a batch found: one table, the best parameters, what got worse.",
    ),
    "table": ("pfcli.cli.commands.table:table", "The range table of a map, as localize-lookup uses it."),
    "warm": ("pfcli.cli.commands.warm:warm", "Compile kernels beforehand, for CI images and containers."),
    "params": ("pfcli.cli.commands.params:params", "A system's parameters as TOML."),
    "new-system": ("pfcli.cli.commands.new_system:new_system", "A package with a system of your own."),
}


class _Lazy(click.Group):
    """Imports a command when it is asked for, so that --help stays fast."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [*systems(), *_COMMANDS]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name in systems():
            found: click.Command = importlib.import_module("pfcli.cli.system_command").command(name)
            return found
        if name in unusable():
            raise UsageError(unusable()[name])
        if name not in _COMMANDS:
            return None
        module, attribute = _COMMANDS[name][0].split(":")
        command: click.Command = getattr(importlib.import_module(module), attribute)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Raises a usage error that names what may have been meant."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            near = difflib.get_close_matches(args[0], self.list_commands(ctx), n=2, cutoff=0.5)
            if near and "Did you mean" not in error.message:
                raise click.UsageError(f"{error.message} Did you mean {' or '.join(near)}?", ctx) from None
            raise

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Systems"):
            formatter.write_dl([(name, system.summary) for name, system in systems().items()])
        if unusable():
            with formatter.section("Cannot be used"):
                formatter.write_dl(list(unusable().items()))
        with formatter.section("Around them"):
            formatter.write_dl([(name, text) for name, (_, text) in _COMMANDS.items()])


@click.command(cls=_Lazy, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="pfcli")
def main() -> None:
    """Replay recorded robot logs offline through published particle-filter systems.

    Exit codes: 0 done, 1 failed, 2 usage, 3 done with a finding of loss or doubt, 4 judged and not passed, 130 interrupted.
    """


def run() -> None:
    """Entry point: every foreseen failure is one line on standard error."""
    try:
        result: Any = main.main(standalone_mode=False, prog_name="pfcli")
        sys.exit(result if isinstance(result, int) else 0)
    except PfcliError as error:
        click.echo(f"pfcli: {printable(str(error))}", err=True)
        sys.exit(error.exit_code)
    except click.exceptions.Exit as done:
        sys.exit(done.exit_code)
    except (KeyboardInterrupt, click.Abort):
        click.echo("pfcli: interrupted; nothing was written", err=True)
        sys.exit(EXIT_INTERRUPTED)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
    except MemoryError:
        click.echo("pfcli: out of memory; fewer --particles or a coarser --resolution-m need less", err=True)
        sys.exit(EXIT_FAILED)
    except OSError as error:
        if error.filename is None and error.errno in (errno.ENOSPC, errno.EFBIG, errno.EDQUOT):
            click.echo(f"pfcli: {reason(error)}; PFCLI_CACHE_DIR names another place for compiled kernels", err=True)
            sys.exit(EXIT_FAILED)
        click.echo(f"pfcli: {printable(str(error.filename or 'input or output'))}: {reason(error)}", err=True)
        sys.exit(EXIT_FAILED)
