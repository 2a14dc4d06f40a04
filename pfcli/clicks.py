"""What the command-line options of several modules are made of."""

import math
import tomllib
from pathlib import Path
from typing import Any

import click

from pfcli.errors import LogError, UsageError, reason


class Finite(click.FloatRange):
    """A number within limits; NaN is none."""

    name = "float"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Raises click's usage error for NaN and infinity."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


def read_toml(path: Path, flag: str) -> dict[str, Any]:
    """A TOML file that a flag names. Raises LogError or UsageError naming both."""
    try:
        return tomllib.loads(path.read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{flag} {path}: cannot be read ({reason(error)})") from None
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{flag} {path}: is not TOML ({reason(error)})") from None
