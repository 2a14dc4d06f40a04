"""`pfcli params SYSTEM`."""

import click

from pfcli import registry
from pfcli.params import to_toml


@click.command()
@click.argument("system", type=click.Choice(list(registry.records())))
def params(system: str) -> None:
    """Print the parameters of SYSTEM as TOML, with defaults, units and ranges.

    Example: pfcli params slam-gdr > my.toml; pfcli slam-gdr log.mcap --params my.toml --out out
    """
    click.echo(to_toml(registry.system(system).params()), nl=False)
