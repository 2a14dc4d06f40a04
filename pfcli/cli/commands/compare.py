"""`pfcli compare DIR...`."""

from pathlib import Path
from typing import Any

import click

from pfcli.errors import UsageError
from pfcli.formats.atomic import check_picture


@click.command()
@click.argument("folders", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--plot", type=click.Path(path_type=Path), help="Draw the tracks over the map of the first run: PNG, SVG or PDF."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def compare(folders: tuple[Path, ...], plot: Path | None, as_json: bool) -> None:
    """Runs side by side: errors against truth, how far each track is from the first (tracks of SLAM after alignment), times, and
    which parameters, inputs and versions differ.

    Example: pfcli compare out/a out/b --plot both.png
    """
    if len(folders) < 2:
        raise UsageError("compare needs two runs or more: pfcli compare DIR DIR")
    if plot is not None:
        check_picture(plot)
    from pfcli.cli.printing import emit
    from pfcli.reports import comparison as compared

    runs = compared.read(folders)
    rows, differing = compared.rows(runs), compared.differences(runs)
    if plot is not None:
        from pfcli.reports.plots import draw_tracks

        draw_tracks(plot, compared.grid_of(folders), {run.name: run.poses for run in runs})
    lines = _table([list(rows[0]), *([row[name] for name in rows[0]] for row in rows)])
    if differing:
        lines += [
            "",
            *_table([["what differs", *(run.name for run in runs)], *([k, *v] for k, v in differing.items())]),
        ]
    emit({"runs": rows, "differences": differing}, lines, as_json)


def _table(rows: list[list[Any]]) -> list[str]:
    """Columns under each other."""
    text = [
        ["-" if cell is None else f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row]
        for row in rows
    ]
    widths = [max(len(row[k]) for row in text) for k in range(len(text[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in text]
