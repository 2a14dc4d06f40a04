"""`pfcli new-system NAME DIR`."""

import re
from importlib.resources import files
from pathlib import Path
from string import Template

import click

from pfcli.errors import UsageError
from pfcli.formats.atomic import output_dir

_FILES = {
    "pyproject.toml": "pyproject.toml.txt",
    "$package/__init__.py": "record.txt",
    "$package/params.py": "params.txt",
    "$package/filter.py": "filter.txt",
    "$package/PAPER.md": "PAPER.md.txt",
    "tests/test_$package.py": "test.txt",
}
"""File of the package -> file of the template."""

_WORLD, _SECONDS, _SEED = "small-loop", 30.0, 7
"""What the sample log shows."""


@click.command("new-system")
@click.argument("name")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
def new_system(name: str, folder: Path) -> None:
    """Write an installable package with the system NAME into DIR: parameters, filter, paper page, tests, a sample log.

    It runs as it stands: Monte Carlo localisation in a known map. `docs/add-a-system.md` goes on from there.

    Example: pfcli new-system my-filter my-filter && pip install ./my-filter && pfcli my-filter --help
    """
    from pfcli.simulation import scenario

    words = {"name": name, "package": _package(name)}
    template = files("pfcli.cli") / "system_template"
    with output_dir(folder, force=False) as made:
        for target, source in _FILES.items():
            path = made / Template(target).substitute(words)
            path.parent.mkdir(exist_ok=True)
            path.write_text(Template((template / source).read_text()).substitute(words))
        world = scenario.SCENARIOS[_WORLD]._replace(duration_s=_SECONDS)
        scenario.write(world, _SEED, made / "tests/room.mcap")
        scenario.write_map(world, made / "tests", "room")
    click.echo(f"{folder}: a package with the system {name}; pip install {folder}, then pfcli {name} --help")


def _package(name: str) -> str:
    """The package of a system. Raises UsageError where it could not be a command, or is one."""
    from pfcli.cli.app import main

    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name):
        raise UsageError(
            f"new-system {name}: a name is made of small letters, digits and single dashes, such as my-filter"
        )
    if name in main.list_commands(click.Context(main)) or name == "pfcli":
        raise UsageError(f"new-system {name}: pfcli has a command of that name; choose another")
    return name.replace("-", "_")
