"""`pfcli table MAP`."""

import time
from pathlib import Path

import click

from pfcli import registry
from pfcli.cli.types import Finite, max_map_option, unknown_grey_option
from pfcli.errors import LogError


@click.command()
@click.argument("map_file", metavar="MAP", type=click.Path(path_type=Path))
@click.option("--bins", type=click.IntRange(72, 720), default=None, help="Directions per turn.  (default: 360)")
@click.option("--table-range-m", type=Finite(0.1, 1000), default=None, help="Longest ray [m].  (default: 30)")
@click.option("--veil-m", type=Finite(0, 10), default=None, help="As of localize-lookup [m].  (default: 0.3)")
@click.option(
    "--check", type=click.IntRange(0, 10_000_000), default=0, help="Compare so many random rays with exact ones."
)
@max_map_option
@unknown_grey_option
@click.option("--force", is_flag=True, help="Build it again even if it is there.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON object.")
def table(
    map_file: Path,
    bins: int | None,
    table_range_m: float | None,
    veil_m: float | None,
    check: int,
    max_map_mpx: float,
    unknown_grey: int | None,
    force: bool,
    as_json: bool,
) -> None:
    """Build the range table of MAP (its YAML) for localize-lookup, or say what is in the cache.

    Example: pfcli table office.yaml --check 100000
    """
    from pfcli.cli.printing import emit
    from pfcli.core.grid import raycast
    from pfcli.formats import map_yaml, range_table_file

    defaults = registry.system("localize-lookup").params()
    bins, range_m = bins or defaults.bins, table_range_m or defaults.table_range_m
    veil_m = defaults.veil_m if veil_m is None else veil_m
    grid = map_yaml.read(map_file, max_map_mpx, -1 if unknown_grey is None else unknown_grey)
    seen = grid._replace(cells=raycast.unveiled(grid.cells, grid.resolution_m, veil_m))
    if not (grid.cells == 0).any() or not (grid.cells == 1).any():
        raise LogError(f"{map_file}: has no free cells or no occupied ones, so no range can be expected of it")
    began = time.perf_counter()
    if force:
        range_table_file.path_of(seen, bins, range_m).unlink(missing_ok=True)
    loaded = range_table_file.load(seen, bins, range_m)
    seconds = time.perf_counter() - began
    found = {
        "file": str(loaded.path),
        "origin": loaded.origin,
        "free_cells": int(loaded.table.ranges.shape[0]),
        "bins": bins,
        "range_m": range_m,
        "mib": round(loaded.table.ranges.nbytes / 2**20, 1),
        "seconds": round(seconds, 3),
    }
    lines = [
        f"{loaded.path}: {loaded.origin} in {seconds:.2f} s; {found['free_cells']} cells x {bins} directions,"
        f" {found['mib']} MiB, up to {range_m:g} m"
    ]
    if check:
        from pfcli.core.sensor.range_table import deviation

        off = deviation(loaded.table, seen.cells, seen.resolution_m, check)
        found |= {"within_one_cell": round(off[0], 4), "within_two_cells": round(off[1], 4)}
        lines.append(f"{check} random rays: {off[0]:.2%} within one cell of the exact range, {off[1]:.2%} within two")
    emit(found, lines, as_json)
