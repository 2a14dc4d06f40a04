"""Range tables in the user's cache: one file per map, resolution, directions and range, mapped into memory.

A file is written beside its place and renamed, so that two processes may build it at once and a killed one leaves
nothing that is taken for whole. It is trusted only when its checksum fits: else it is built again.
"""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.grid_map import GridMap
from pfcli.core.jit import cache_root, kernel
from pfcli.core.sensor import range_table
from pfcli.core.sensor.range_table import RangeTable
from pfcli.core.threads import spread
from pfcli.errors import OutputError, reason
from pfcli.formats import map_yaml
from pfcli.formats.atomic import check_file, output_file

_MAGIC = b"pfcli range table 1\n"
_HEAD = 4096
_BLOCK = 1 << 16


class Loaded(NamedTuple):
    """table; path of its file; origin: `kept` (was in the cache), `built`, or `rebuilt: WHY`."""

    table: RangeTable
    path: Path
    origin: str


def path_of(grid: GridMap, bins: int, range_m: float) -> Path:
    """Where the table of a map is kept."""
    return cache_root() / "range-tables" / f"{map_yaml.digest(grid)[:24]}-{bins}-{range_m:g}.ranges"


def load(grid: GridMap, bins: int, range_m: float) -> Loaded:
    """The table of a map from the cache; built where it is not there or cannot be trusted.

    Raises OutputError where the cache folder cannot be written.
    """
    path = path_of(grid, bins, range_m)
    wanted = _header(grid, bins, range_m)
    why = "built"
    if path.exists():
        why = _fault(path, wanted)
        if not why:
            ranges = np.memmap(path, np.uint16, "r", _HEAD, (wanted["rows"], bins))
            return Loaded(_table(ranges, grid, range_m), path, "kept")
        why = f"rebuilt: {why}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        check_file(path, force=True)
        _write(path, wanted, lambda out: _fill(out, grid, bins, range_m))
        ranges = np.memmap(path, np.uint16, "r", _HEAD, (wanted["rows"], bins))
    except (OSError, OutputError) as error:
        raise OutputError(
            f"{path.parent}: the range table cannot be kept ({reason(error)}); set PFCLI_CACHE_DIR, or --ranges rays"
        ) from None
    return Loaded(_table(ranges, grid, range_m), path, why)


def _table(ranges: NDArray[np.uint16], grid: GridMap, range_m: float) -> RangeTable:
    return range_table.over(ranges, grid.cells, grid.resolution_m, grid.origin, range_m)


def _fill(out: NDArray[np.uint16], grid: GridMap, bins: int, range_m: float) -> None:
    range_table.build(grid.cells, grid.resolution_m, grid.origin, bins, range_m, out)


def _header(grid: GridMap, bins: int, range_m: float) -> dict[str, Any]:
    """What a file must say to be this map's table."""
    rows = int((grid.cells == 0).sum())
    return {"rows": rows, "bins": bins, "range_m": range_m, "resolution_m": float(grid.resolution_m)}


def _write(path: Path, header: dict[str, Any], fill: Callable[[NDArray[np.uint16]], None]) -> None:
    with output_file(path) as partial:
        size = _HEAD + header["rows"] * header["bins"] * 2
        with open(partial, "wb") as file:
            os.posix_fallocate(file.fileno(), 0, size) if hasattr(os, "posix_fallocate") else file.truncate(size)
        out = np.memmap(partial, np.uint16, "r+", _HEAD, (header["rows"], header["bins"]))
        fill(out)
        out.flush()
        text = json.dumps(header | {"checksum": checksum(out)}).encode()
        with open(partial, "r+b") as file:
            file.write(_MAGIC + text.ljust(_HEAD - len(_MAGIC)))


def _fault(path: Path, wanted: dict[str, Any]) -> str:
    """Why a file cannot be used, '' if it can."""
    size = _HEAD + wanted["rows"] * wanted["bins"] * 2
    try:
        with open(path, "rb") as file:
            head = file.read(_HEAD)
        if not head.startswith(_MAGIC):
            return "it is no range table"
        found = json.loads(head[len(_MAGIC) :])
        if not isinstance(found, dict):
            return "its header cannot be read"
        if {key: found.get(key) for key in wanted} != wanted:
            return "it belongs to another map"
        if path.stat().st_size != size:
            return "it is not whole"
        ranges = np.memmap(path, np.uint16, "r", _HEAD, (wanted["rows"], wanted["bins"]))
        return "" if checksum(ranges) == found.get("checksum") else "its checksum is wrong"
    except (OSError, ValueError) as error:
        return f"it cannot be read ({reason(error)})"


def checksum(ranges: NDArray[np.uint16]) -> str:
    """Of all entries and their places; at the speed of memory, since it is taken at every start."""
    flat = ranges.reshape(-1)
    whole = flat[: flat.size // 4 * 4].view(np.uint64)
    sums = np.zeros(-(-whole.size // _BLOCK), np.uint64)
    spread(_sum_blocks, sums.size, whole, sums)
    tail = int(flat[whole.size * 4 :].astype(np.uint64) @ np.arange(1, flat.size - whole.size * 4 + 1, dtype=np.uint64))
    total = sum((2 * k + 1) * int(s) for k, s in enumerate(sums)) + tail
    return f"{total % (1 << 64):016x}"


@kernel
def _sum_blocks(low, high, words, sums):
    """Sum of (2 k + 1) word_k over each block: an odd factor lets no changed bit vanish."""
    for block in range(low, high):
        first, last = block * 65536, min((block + 1) * 65536, words.size)
        total = np.uint64(0)
        for k in range(first, last):
            total += words[k] * np.uint64(2 * (k - first) + 1)
        sums[block] = total
