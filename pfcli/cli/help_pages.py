"""Help of a system's command: one screen with what most runs need, and everything, in groups, by `--help-all`."""

from typing import Any

import click

from pfcli import registry
from pfcli.params import fields

_ALL = "pfcli.help_all"
_USUAL = (
    "map_file",
    "out",
    "truth",
    "initial",
    "motion",
    "particles",
    "seed",
    "params_file",
    "topic",
    "plot",
    "report",
    "force",
)
"""Options of the one screen, in its order."""
_OF_FILTER = ("seed", "params_file")
_OF_OUTPUT = ("out", "force", "overlay", "report", "plot", "animate", "threads")
_OF_SAYING = ("progress_mode", "as_json", "quiet", "ignore", "strict")
_OF_HELP = ("help", "help_all")


class SystemCommand(click.Command):
    """The command of a system, and its help."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """One screen, or after `--help-all` what goes in, the filter's parameters, what comes out."""
        options = [param for param in self.get_params(ctx) if isinstance(param, click.Option)]
        sections = self._grouped(options) if ctx.find_root().meta.get(_ALL) else self._usual(options)
        for title, members in sections.items():
            records = [record for option in members if (record := option.get_help_record(ctx)) is not None]
            with formatter.section(title):
                formatter.write_dl(records)

    def _usual(self, options: list[click.Option]) -> dict[str, list[click.Option]]:
        named: dict[str, click.Option] = {str(option.name): option for option in options}
        variants = registry.system(str(self.name)).variants
        usual = [named[name] for name in (*_USUAL, *variants) if name in named]
        required = [option for option in usual if option.required]
        others = [option for option in usual if not option.required]
        return {"Required": required, "Often used": others + [named[name] for name in _OF_HELP if name in named]}

    def _grouped(self, options: list[click.Option]) -> dict[str, list[click.Option]]:
        system = registry.system(str(self.name))
        own = {field.name for record in (system, *system.variants.values()) for field in fields(record.params)}
        groups: dict[str, list[click.Option]] = {"Input": [], "Filter": [], "Output": []}
        for option in options:
            of_filter = option.name in own or option.name in _OF_FILTER or option.name in system.variants
            of_output = option.name in (*_OF_OUTPUT, *_OF_SAYING, *_OF_HELP)
            groups["Filter" if of_filter else "Output" if of_output else "Input"].append(option)
        return groups


def whole(context: click.Context) -> click.Context:
    """The context of a command whose help shall be whole, as the reference of the documentation shows it."""
    context.find_root().meta[_ALL] = True
    return context


def _show_all(ctx: click.Context, param: click.Parameter, value: Any) -> None:
    if value and not ctx.resilient_parsing:
        click.echo(whole(ctx).command.get_help(ctx))
        ctx.exit()


help_all_option = click.option(
    "--help-all",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_all,
    help="Every option, in groups.",
)
