"""TOML files that a flag names."""

import tomllib
from pathlib import Path
from typing import Any

from pfcli.errors import LogError, UsageError, reason


def read_toml(path: Path, flag: str) -> dict[str, Any]:
    """A TOML file that a flag names. Raises LogError or UsageError naming both."""
    try:
        return tomllib.loads(path.read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{flag} {path}: cannot be read ({reason(error)})") from None
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{flag} {path}: is not TOML ({reason(error)})") from None
