"""The systems by the name of their command; a module is imported only when its system is used."""

import importlib
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

SYSTEMS = {
    "fuse-soccer": "pfcli.systems.fuse_soccer.filter:SYSTEM",
    "localize-lookup": "pfcli.systems.localize_lookup.filter:SYSTEM",
    "localize-partial": "pfcli.systems.localize_partial.filter:SYSTEM",
    "localize-reliable": "pfcli.systems.localize_reliable.filter:SYSTEM",
    "slam-gdr": "pfcli.systems.slam_gdr.filter:SYSTEM",
    "slam-gdr-landmarks": "pfcli.systems.slam_landmarks.filter:SYSTEM",
}

PARAMS = {
    "fuse-soccer": "pfcli.systems.fuse_soccer.params:Params",
    "localize-lookup": "pfcli.systems.localize_lookup.params:Params",
    "localize-partial": "pfcli.systems.localize_partial.params:Params",
    "localize-reliable": "pfcli.systems.localize_reliable.params:Params",
    "slam-gdr": "pfcli.systems.slam_gdr.params:Params",
    "slam-gdr-landmarks": "pfcli.systems.slam_landmarks.params:Params",
}

LANDMARKS = {"slam-gdr": "slam-gdr-landmarks"}
"""Command -> the system that it is with --landmarks."""

MAPPED = frozenset({"localize-lookup", "localize-partial", "localize-reliable"})
"""Systems that need a map: their commands have --map."""

LOCALISERS = MAPPED | {"fuse-soccer"}
"""Systems whose poses are in a frame that is given: their commands have --initial and --heading-prior."""

SUMMARY = {
    "fuse-soccer": "A soccer robot on its field, from wheels, field lines and landmarks, and a compass.",
    "localize-lookup": "Global localisation: headings from one match, ranges from a precomputed table.",
    "localize-partial": "Monte Carlo localisation in an incomplete map: where, and is the robot in the map at all?",
    "localize-reliable": "A pose that says whether it can be trusted, which beams the map explains, and finds itself again.",
    "slam-gdr": "Rao-Blackwellised SLAM with Gaussian distributed resampling, from laser scans or landmarks.",
}


class System(NamedTuple):
    """One particle-filter system.

    needs: alternatives, each a set of event kinds that is enough to run; wants: kinds that are read whenever the log has them;
    readings: what its users call what it is fed; unusable: what none of them does where nothing could be estimated;
    load(params, settings) -> assets (tables, maps); init(params, assets, first odometry pose, draw) -> state;
    step(state, reading, assets, params, draw) -> (state, Info or None); finish(state, ...) -> Result.
    """

    name: str
    params: type
    info: type
    needs: tuple[frozenset[str], ...]
    load: Callable[..., Any]
    init: Callable[..., Any]
    step: Callable[..., Any]
    finish: Callable[..., Any]
    wants: tuple[str, ...] = ()
    readings: str = "scans"
    unusable: str = "has a usable beam (see --max-range-m)"


def _resolve(target: str) -> Any:
    module, name = target.split(":")
    return getattr(importlib.import_module(module), name)


def system(name: str) -> System:
    """The System record behind a command name."""
    found: System = _resolve(SYSTEMS[name])
    return found


def params_class(name: str) -> type:
    """The Params class of a system, without importing its kernels."""
    found: type = _resolve(PARAMS[name])
    return found


def all_systems() -> Iterator[System]:
    """Every registered system."""
    return (system(name) for name in SYSTEMS)
