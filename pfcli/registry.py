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


def systems() -> "Mapping[str, System]":
    """Name of the command -> record. Raises UsageError where pfcli itself is not installed."""
    return _read()[0]


def unusable() -> Mapping[str, str]:
    """Name -> why the system that a package brings cannot be used; the others can."""
    return _read()[1]


@cache
def _read() -> "tuple[Mapping[str, System], Mapping[str, str]]":
    found: dict[str, System] = {}
    broken: dict[str, str] = {}
    for name, points in _points(SYSTEMS).items():
        try:
            found[name] = _record(name, points)
        except UsageError as error:
            broken[name] = str(error)
    return MappingProxyType(found), MappingProxyType(broken)


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
    if found is None and name in unusable():
        raise UsageError(unusable()[name])
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
    points = _points(RESAMPLERS).get(name)
    if points is None:
        raise UsageError(f"there is no resampler {name!r}; known: {', '.join(resampler_names())}")
    found: Callable[..., Any] = _loaded("resampler", points)
    return found


@cache
def resampler_names() -> tuple[str, ...]:
    """The names of all resamplers, without importing one."""
    return tuple(_points(RESAMPLERS))


@cache
def _installed() -> Any:
    """All entry points: every package is looked at once, not once for each group."""
    return entry_points()


def _points(group: str) -> dict[str, list[EntryPoint]]:
    """The entry points of a group by name; several where packages bring the same name."""
    found: dict[str, list[EntryPoint]] = {}
    for point in sorted(_installed().select(group=group), key=lambda point: (point.name, point.value)):
        found.setdefault(point.name, []).append(point)
    if not any(point.value.startswith("pfcli.") for points in found.values() for point in points):
        raise UsageError("pfcli is not installed, so its systems cannot be found: pip install -e .")
    return found


def _loaded(what: str, points: list[EntryPoint]) -> Any:
    name, values = points[0].name, sorted({point.value for point in points})
    if len(values) > 1:
        raise UsageError(f"{what} {name!r} is brought by two packages, as {' and '.join(values)}; uninstall one")
    try:
        return points[0].load()
    except Exception as error:
        raise UsageError(f"{what} {name!r} ({values[0]}) cannot be imported: {error}") from None


def _record(name: str, points: list[EntryPoint]) -> "System":
    record: System = _loaded("system", points)
    if getattr(record, "name", None) != name:
        raise UsageError(f"system {name!r}: {points[0].value} is no System record of that name")
    return record
