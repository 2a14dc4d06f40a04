"""What the command-line options of several modules are made of."""

import atexit
import math
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any

import click

from pfcli.formats.limits import DEFAULTS


class Finite(click.FloatRange):
    """A number within limits; NaN is none."""

    name = "float"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Raises click's usage error for NaN and infinity."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Readable(click.Path):
    """A file to read; `-`: standard input, which is kept in a file for as long as the command runs."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Standard input is read here, as a whole, for logs are read more than once."""
        if str(value) != "-":
            return super().convert(value, param, ctx)
        folder = tempfile.mkdtemp(prefix="pfcli-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        path = Path(folder) / "stdin"
        with open(path, "wb") as out:
            shutil.copyfileobj(sys.stdin.buffer, out)
        return path


max_chunk_option = click.option(
    "--max-chunk-mib",
    type=Finite(0, 1 << 20, min_open=True),
    default=DEFAULTS.chunk_mib,
    show_default=True,
    help="A chunk of a log that holds more is left out [MiB].",
)
max_map_option = click.option(
    "--max-map-mpx",
    type=Finite(0, 1e5, min_open=True),
    default=DEFAULTS.map_mpx,
    show_default=True,
    help="Largest map that is read [million pixels].",
)


unknown_grey_option = click.option(
    "--unknown-grey",
    type=click.IntRange(0, 255),
    default=None,
    metavar="SHADE",
    help="A shade of the map that is unknown whatever its free_thresh says; map_saver draws unknown cells as 205.",
)


@contextmanager
def streamed(target: Path) -> Iterator[Path]:
    """The file to write; for `-` one whose bytes go to standard output in the end, and what is said to standard error."""
    if str(target) != "-":
        yield target
        return
    with tempfile.TemporaryDirectory(prefix="pfcli-") as folder:
        path, out = Path(folder) / "stdout.mcap", sys.stdout
        with redirect_stdout(sys.stderr):
            yield path
        with open(path, "rb") as written:
            shutil.copyfileobj(written, out.buffer)
