"""How a system declares its parameters: a frozen keyword-only dataclass whose fields carry an `Opt`."""

import dataclasses
import math
import typing
from collections.abc import Mapping
from typing import Any, NamedTuple

from pfcli.errors import UsageError


class Opt(NamedTuple):
    """What a parameter means: help text, unit ('' for a pure number) and legal range or choices."""

    help: str
    unit: str = ""
    ge: float | None = None
    le: float | None = None
    choices: tuple[str, ...] = ()


class Field(NamedTuple):
    """One declared parameter."""

    name: str
    kind: type
    opt: Opt
    default: Any

    @property
    def flag(self) -> str:
        """The command-line flag."""
        return "--" + self.name.replace("_", "-")

    def check(self, value: object, where: str) -> Any:
        """The value as the field's type. Raises UsageError where it does not fit."""
        if self.kind is bool:
            if isinstance(value, bool):
                return value
            raise UsageError(f"{where}: {self.name} must be true or false, not {value!r}")
        if self.kind is str:
            if isinstance(value, str) and (not self.opt.choices or value in self.opt.choices):
                return value
            raise UsageError(f"{where}: {self.name} must be one of {', '.join(self.opt.choices)}, not {value!r}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise UsageError(f"{where}: {self.name} must be a number, not {value!r}")
        if self.kind is int and value != int(value):
            raise UsageError(f"{where}: {self.name} must be a whole number, not {value!r}")
        low = -math.inf if self.opt.ge is None else self.opt.ge
        high = math.inf if self.opt.le is None else self.opt.le
        if not math.isfinite(value) or not low <= value <= high:
            unit = f" {self.opt.unit}" if self.opt.unit else ""
            raise UsageError(f"{where}: {self.name} = {value!r} is outside {low:g} .. {high:g}{unit}")
        return self.kind(value)


def fields(params: type) -> list[Field]:
    """The declared parameters of a Params class, in the order in which they stand."""
    hints = typing.get_type_hints(params, include_extras=True)
    found = []
    for field in dataclasses.fields(params):
        kind, *extras = typing.get_args(hints[field.name])
        opt = next(extra for extra in extras if isinstance(extra, Opt))
        found.append(Field(field.name, kind, opt, field.default))
    return found


def build(params: type, values: Mapping[str, object], where: str) -> Any:
    """Params from a mapping; unknown names and illegal values raise UsageError naming `where`."""
    known = {field.name: field for field in fields(params)}
    unknown = sorted(set(values) - set(known))
    if unknown:
        raise UsageError(f"{where}: unknown parameter {unknown[0]!r}; `pfcli params` lists the legal ones")
    return params(**{name: known[name].check(value, where) for name, value in values.items()})


def to_toml(params: object) -> str:
    """Parameters as TOML with help, unit and range as comments; `--params` reads it back."""
    lines = []
    for field in fields(type(params)):
        value = getattr(params, field.name)
        bounds = [f">= {field.opt.ge:g}"] if field.opt.ge is not None else []
        bounds += [f"<= {field.opt.le:g}"] if field.opt.le is not None else []
        bounds += [" | ".join(field.opt.choices)] if field.opt.choices else []
        note = ", ".join(([field.opt.unit] if field.opt.unit else []) + bounds)
        lines.append(f"# {field.opt.help}" + (f" ({note})" if note else ""))
        lines.append(f"{field.name} = {_toml_value(value)}")
    return "\n".join(lines) + "\n"


def _toml_value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return f'"{value}"' if isinstance(value, str) else repr(value)
