"""Known or found landmarks as CSV: `id,x_m,y_m` and more columns, which are kept for people."""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from pfcli.errors import LogError, reason
from pfcli.formats import text_files
from pfcli.formats.atomic import output_file


def read(path: Path) -> dict[str, tuple[float, float]]:
    """Landmarks by id. Raises LogError naming the file, the line and the field."""
    try:
        rows = list(csv.DictReader(io.StringIO(text_files.whole(path, "landmarks"))))
    except csv.Error as error:
        raise LogError(f"{path}: cannot be read as landmarks ({reason(error)})") from None
    found: dict[str, tuple[float, float]] = {}
    for number, row in enumerate(rows, 2):
        try:
            name, x, y = str(row["id"]), float(row["x_m"]), float(row["y_m"])
        except (KeyError, TypeError, ValueError):
            raise LogError(f"{path}: line {number}: the fields id, x_m, y_m are needed") from None
        if not math.isfinite(x + y) or name in found:
            what = (
                f"id {name!r} stands twice" if name in found else f"x_m, y_m are not usable: {row['x_m']}, {row['y_m']}"
            )
            raise LogError(f"{path}: line {number}: {what}")
        found[name] = (x, y)
    if not found:
        raise LogError(f"{path}: holds no landmarks; a first line id,x_m,y_m and one line for each are needed")
    return found


def write(path: Path, places: Mapping[str, tuple[float, float]]) -> None:
    """Landmarks by id as CSV, in one rename. Raises OutputError where the file cannot be written."""
    rows: dict[str, Sequence[object]] = {
        "id": list(places),
        "x_m": [x for x, _ in places.values()],
        "y_m": [y for _, y in places.values()],
    }
    with output_file(path) as partial:
        partial.write_text(text(rows))


def text(columns: Mapping[str, Sequence[object]]) -> str:
    """Columns of equal length as CSV."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return out.getvalue()
