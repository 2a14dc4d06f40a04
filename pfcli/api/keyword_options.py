"""Keyword arguments as the words of a command, so that both are read by one parser."""

import dataclasses
import os
from collections.abc import Iterator, Mapping
from typing import Any

from pfcli.cli import system_command
from pfcli.errors import UsageError
from pfcli.params import fields
from pfcli.systems.shared.contract import System

_OF_THE_COMMAND = {
    "out": "save",
    "force": "save",
    "overlay": "save",
    "report": "save",
    "animate": "save",
    "plot": "plot",
    "json": "summary",
    "quiet": "findings",
    "strict": "findings",
}
"""Options that say what a command writes -> what a run has for it."""


def run_words(system: System, options: Mapping[str, Any]) -> list[str]:
    """The words that the command of a system is given. Raises UsageError for an option that only the command has, and for
    parameters of another system."""
    flags = system_command.flags(system.name.split()[0])
    words: list[str] = []
    for name, value in options.items():
        if name in _OF_THE_COMMAND:
            raise UsageError(f"{name}= is an option of the command only; the run has .{_OF_THE_COMMAND[name]}")
        if name == "params" and dataclasses.is_dataclass(value):
            if type(value) is not system.params:
                raise UsageError(
                    f"params= is for another system; default_params({system.name!r}) gives those of this one"
                )
            words = [*_changed(value), *words]
            continue
        flag = "--" + name.replace("_", "-")
        known = flags.get(flag)
        words += _words(
            flag, value, many=known is not None and known.multiple, on_off=known is not None and known.on_off
        )
    return words


def _changed(params: Any) -> Iterator[str]:
    """Parameters that are not the defaults."""
    for field in fields(type(params)):
        value = getattr(params, field.name)
        if value != field.default:
            yield from _words(field.flag, value, many=False, on_off=field.kind is bool)


def _words(flag: str, value: Any, *, many: bool, on_off: bool) -> list[str]:
    if value is None:
        return []
    if isinstance(value, bool):
        return [flag] if value else [f"--no-{flag[2:]}"] if on_off else []
    if many and isinstance(value, Mapping):
        return [f"{flag}={key}={_text(one)}" for key, one in value.items()]
    if many and not isinstance(value, str | os.PathLike | int | float):
        return [f"{flag}={_text(one)}" for one in value]
    return [f"{flag}={_text(value)}"]


def _text(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
