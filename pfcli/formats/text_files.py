"""Text and YAML files from the outside: compressed or not, of any length, and never believed."""

import bz2
import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from pfcli.errors import LogError, reason

_LONGEST_LINE = 1 << 22
_LARGEST_TEXT = 1 << 28
_LARGEST_YAML = 1 << 22
_ERRORS = (OSError, EOFError, ValueError, zlib.error)


def lines(path: Path, what: str) -> Iterator[str]:
    """Lines of a text file, decompressed by its ending (.gz, .bz2). Raises LogError: it cannot be read as `what`."""
    opener = {".gz": gzip.open, ".bz2": bz2.open}.get(path.suffix, open)
    try:
        with opener(path, "rt", encoding="utf-8", errors="replace") as text:  # type: ignore[operator]
            number = 0
            while line := text.readline(_LONGEST_LINE):
                number += 1
                if len(line) == _LONGEST_LINE:
                    raise LogError(f"{path}: cannot be read as {what} (line {number} is longer than 4 MiB)")
                yield line
    except _ERRORS as error:
        raise LogError(f"{path}: cannot be read as {what} ({reason(error)})") from None


def whole(path: Path, what: str, limit: int = _LARGEST_TEXT) -> str:
    """The text of a file. Raises LogError: it cannot be read as `what`."""
    try:
        with open(path, encoding="utf-8", errors="replace") as text:
            found = text.read(limit + 1)
    except _ERRORS as error:
        raise LogError(f"{path}: cannot be read as {what} ({reason(error)})") from None
    if len(found) > limit:
        raise LogError(f"{path}: cannot be read as {what} (it is longer than {limit >> 20} MiB)")
    return found


class _PlainLoader(yaml.SafeLoader):
    """YAML without aliases: a few lines of them can stand for more than fits into memory."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("anchors and aliases are not read")
        return super().compose_node(parent, index)


def mapping(path: Path, what: str) -> dict[str, Any] | None:
    """The mapping that a YAML file holds, None where it holds something else. Raises LogError: it cannot be read as `what`."""
    text = whole(path, what, _LARGEST_YAML)
    try:
        found = yaml.load(text, _PlainLoader)
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, RecursionError, AttributeError) as error:
        raise LogError(f"{path}: cannot be read as {what} ({reason(error)})") from None
    if not isinstance(found, dict):
        return None
    return {str(key): value for key, value in found.items()}
