"""All that can be simulated: each kind of scenario is one module with the same functions."""

import math
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

from pfcli.errors import LogError, UsageError, reason
from pfcli.simulation import landmark_world, scenario, soccer_world

KINDS: dict[type, ModuleType] = {
    scenario.Scenario: scenario,
    landmark_world.LandmarkWorld: landmark_world,
    soccer_world.Soccer: soccer_world,
}
"""Scenario type -> module with SCENARIOS, check, described, write and write_map."""

_SIGNED = ("compass_bias_deg",)


def all_scenarios() -> dict[str, Any]:
    """Every scenario by name."""
    return {name: found for module in KINDS.values() for name, found in module.SCENARIOS.items()}


def load(text: str) -> Any:
    """A scenario by name, from a TOML file with the fields of one kind, or from a JSON world of landmarks."""
    known = all_scenarios()
    if text in known:
        return known[text]
    path = Path(text)
    if path.suffix == ".json":
        return landmark_world.read(path)
    if path.suffix != ".toml":
        raise UsageError(f"no scenario {text!r}; there are {', '.join(known)}, or name a .toml or .json file")
    try:
        given = tomllib.loads(path.read_text())
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise LogError(f"{path}: cannot be read as a scenario ({reason(error)})") from None
    kind = max(KINDS, key=lambda k: len(set(given) & set(k._fields)))  # type: ignore[attr-defined]
    types = {k: type(v) for k, v in kind("x")._asdict().items()}
    for key, value in given.items():
        if key not in types or not isinstance(value, (int, float) if types[key] is float else types[key]):
            raise UsageError(f"{path}: field {key!r} is unknown or of the wrong type; known: {', '.join(types)}")
        if isinstance(value, int | float) and not (0 <= value < math.inf or key in _SIGNED):
            raise UsageError(f"{path}: field {key!r} is {value}: a number that is not negative is needed")
    found = kind(**{"name": path.stem} | given)
    KINDS[kind].check(found, path)
    return found


def described(found: Any) -> str:
    """One line about a scenario."""
    return str(KINDS[type(found)].described(found))


def write(found: Any, seed: int, path: Path) -> dict[str, float]:
    """Write the log of a scenario; returns counts."""
    counts: dict[str, float] = KINDS[type(found)].write(found, seed, path)
    return counts


def write_map(found: Any, folder: Path, name: str) -> None:
    """Write what is true of the place beside the log: its map, its field, its landmarks."""
    KINDS[type(found)].write_map(found, folder, name)


def write_partial_map(found: Any, folder: Path, name: str) -> None:
    """Write the part of the map that the robot is given. Raises UsageError where there is no such thing."""
    if not isinstance(found, scenario.Scenario):
        raise UsageError("--partial-map: only worlds of walls have partial maps")
    scenario.write_partial_map(found, folder, name)
