"""The systems and resamplers that are installed, found by the entry points `pfcli.systems` and `pfcli.resamplers`: ours and
anybody's."""

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
def resampler(name: str) -> Callable[..., Any]:
    """The function `(weights, count, rng) -> ancestors` of a resampler; what it must keep: `pfcli.core.resample.schemes`.

    Raises UsageError where there is none of that name, or where its package cannot be imported."""
    point = _points(RESAMPLERS).get(name)
    if point is None:
        raise UsageError(f"there is no resampler {name!r}; known: {', '.join(resampler_names())}")
    found: Callable[..., Any] = _loaded("resampler", point)
    return found


@cache
def resampler_names() -> tuple[str, ...]:
    """The names of all resamplers, without importing one."""
    return tuple(_points(RESAMPLERS))


@cache
def _installed() -> Any:
    """All entry points: every package is looked at once, not once for each group."""
    return entry_points()


def _points(group: str) -> dict[str, EntryPoint]:
    found: dict[str, EntryPoint] = {}
    for point in sorted(_installed().select(group=group), key=lambda point: point.name):
        other = found.setdefault(point.name, point)
        if other.value != point.value:
            raise UsageError(
                f"{group}: {point.name!r} is brought by two packages, as {other.value} and {point.value}; uninstall one"
            )
    if not any(point.value.startswith("pfcli.") for point in found.values()):
        raise UsageError("pfcli is not installed, so its systems cannot be found: pip install -e .")
    return found


def _loaded(what: str, point: EntryPoint) -> Any:
    try:
        return point.load()
    except Exception as error:
        raise UsageError(f"{what} {point.name!r} ({point.value}) cannot be imported: {error}") from None


def _record(point: EntryPoint) -> "System":
    record: System = _loaded("system", point)
    if getattr(record, "name", None) != point.name:
        raise UsageError(f"system {point.name!r}: {point.value} is no System record of that name")
    return record
