"""`pfcli report DIR`."""

from pathlib import Path

import click

from pfcli.errors import UsageError
from pfcli.formats.atomic import check_file


@click.command()
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Where the page goes (default: DIR/report.html).")
@click.option("--force", is_flag=True, help="Replace a page that is there.")
def report(folder: Path, out: Path | None, force: bool) -> None:
    """One HTML page of the run in DIR: its map and track, charts over time, a slider that moves the robot, its particles and
    its scan, what was left out, the command, parameters and versions. It needs no network and no other file.

    Example: pfcli report out/intel
    """
    if not folder.is_dir():
        raise UsageError(f"{folder}: is not the folder of a run")
    target = out or folder / "report.html"
    if target.suffix not in (".html", ".htm"):
        raise UsageError(f"--out {target}: the ending must be .html")
    check_file(target, force=force)
    from pfcli.reports import page

    size = page.write(folder, target)
    click.echo(f"{target}: {size / 1e6:.2f} MB")
