"""The systems that are installed, found by the entry point `pfcli.systems`: ours and anybody's."""

import importlib
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from pfcli.errors import UsageError

if TYPE_CHECKING:
    from pfcli.systems.shared.contract import AnyFilter, System

SYSTEMS = "pfcli.systems"
RESAMPLERS = "pfcli.resamplers"


@cache
def systems() -> "Mapping[str, System]":
    """Name of the command -> record. Raises UsageError where pfcli itself is not installed, or where two packages bring a system
    of the same name."""
    return MappingProxyType({name: _record(point) for name, point in _points(SYSTEMS).items()})


@cache
def records() -> "Mapping[str, System]":
    """Every record by its key: those behind flags of a command too."""
    found = {}
    for system in systems().values():
        found[system.key] = system
        found |= {variant.key: variant for variant in system.variants.values()}
    return MappingProxyType(found)


def system(name: str) -> "System":
    """The record of a name as commands, `run.json` or `pfcli params` say it. Raises UsageError for an unknown one."""
    found = records().get(name.replace(" --", "-"))
    if found is None:
        raise UsageError(f"there is no system {name!r}; known: {', '.join(records())}")
    return found


def filter_of(system: "System") -> "AnyFilter":
    """The functions of a system; its kernels are imported now."""
    module, name = system.filter.split(":")
    found: AnyFilter = getattr(importlib.import_module(module), name)
    return found


@cache
def resamplers() -> Mapping[str, Callable[..., Any]]:
    """Name -> resampler: `ancestors(weights, count, rng) -> int64 (count,)`. See `pfcli.systems.shared.resampling`."""
    return MappingProxyType({name: point.load() for name, point in _points(RESAMPLERS).items()})


def resampler_names() -> tuple[str, ...]:
    """The names of all resamplers, without importing one."""
    return tuple(_points(RESAMPLERS))


def _points(group: str) -> dict[str, EntryPoint]:
    found: dict[str, EntryPoint] = {}
    for point in sorted(entry_points(group=group), key=lambda point: point.name):
        other = found.setdefault(point.name, point)
        if other.value != point.value:
            raise UsageError(
                f"{group}: {point.name!r} is brought by two packages, as {other.value} and {point.value}; uninstall one"
            )
    if not any(point.value.startswith("pfcli.") for point in found.values()):
        raise UsageError("pfcli is not installed, so its systems cannot be found: pip install -e .")
    return found


def _record(point: EntryPoint) -> "System":
    try:
        record: System = point.load()
    except Exception as error:
        raise UsageError(f"system {point.name!r} ({point.value}) cannot be imported: {error}") from None
    if getattr(record, "name", None) != point.name:
        raise UsageError(f"system {point.name!r}: {point.value} is no System record of that name")
    return record
