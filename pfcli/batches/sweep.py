"""A sweep file, and the jobs that it means.

logs = ["*.mcap"]                 # globs, beside the file
systems = ["slam-gdr"]
seeds = 10                        # 0 .. 9; or a list
[options]                         # flags of the systems, without their dashes; {log}: the log without its ending
truth = "auto"
[options.localize-partial]        # of one system
map = "{log}-partial.yaml"
[grid]                            # every combination; [grid.SYSTEM] of one system
particles = [5, 20]
[[points]]                        # each of these, combined with the grid
resampler = "csw"
"""

import glob
import hashlib
import itertools
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from pfcli.batches.worker import CommandLine
from pfcli.errors import PfcliError, UsageError
from pfcli.formats.toml_file import read_toml
from pfcli.registry import systems

_FIELDS = ("logs", "systems", "seeds", "options", "grid", "points")
_OURS = ("out", "force", "json", "quiet", "progress", "seed", "threads", "plot", "overlay", "help")
_FLAG = re.compile(r"[a-z][a-z0-9-]*")
_MOST_SEED = 2**63 - 1


class Task(NamedTuple):
    """One run. words: of its command line, after the system; point: what the sweep varies; key: hash of what determines it;
    group: hash of the log and of all options that were given, which seeds and versions of pfcli share."""

    key: str
    group: str
    system: str
    log: str
    seed: int
    point: dict[str, Any]
    words: tuple[str, ...]

    def record(self) -> dict[str, Any]:
        """What the job's folder says of itself."""
        return {
            "group": self.group,
            "system": self.system,
            "log": self.log,
            "seed": self.seed,
            "point": self.point,
            "words": list(self.words),
        }


def read(path: Path, cli: CommandLine) -> list[Task]:
    """The jobs of a sweep file, in the order of their keys; `cli` checks every option. Raises UsageError."""
    given = read_toml(path, "sweep")
    unknown = sorted(set(given) - set(_FIELDS))
    if unknown:
        raise UsageError(f"{path}: field {unknown[0]!r} is unknown; known: {', '.join(_FIELDS)}")
    found: dict[str, Task] = {}
    logs, seeds = _logs(path, given), _seeds(path, given)
    for system in _systems(path, given):
        for log in logs:
            for point in _points(path, given, system):
                words = tuple(_words(path, cli, system, _of(given.get("options", {}), system) | point, Path(log)))
                for task in _tasks(path, cli, system, log, seeds, point, words):
                    found.setdefault(task.key, task)
    return [found[key] for key in sorted(found)]


def shard(tasks: list[Task], text: str) -> list[Task]:
    """The i-th of n parts (`i/n`) of the jobs. Raises UsageError."""
    first, _, count = text.partition("/")
    if not (first.isdecimal() and count.isdecimal() and 1 <= int(first) <= int(count)):
        raise UsageError(f"--shard {text}: expected I/N with 1 <= I <= N")
    return tasks[int(first) - 1 :: int(count)]


def _hash(meaning: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(meaning, sort_keys=True, default=str).encode()).hexdigest()[:16]


def _tasks(
    path: Path, cli: CommandLine, system: str, log: str, seeds: list[int], point: dict[str, Any], words: tuple[str, ...]
) -> Iterator[Task]:
    """A job for each seed; what else determines it is looked up once."""
    from pfcli.runs.results import provenance

    line = (log, *words, "--threads", "1", "--progress", "never")
    try:
        job = cli.job(system, (*line, "--out", "."))
        meaning = {**provenance(job), "truth": job.truth}
    except (PfcliError, OSError) as error:
        raise UsageError(f"{path}: {error}") from None
    shown = [Path(word).name if word.startswith("/") else word for word in words]
    group = _hash({"system": system, "options": shown, **{k: meaning[k] for k in ("inputs", "map") if k in meaning}})
    for seed in seeds:
        key = _hash({**meaning, "seed": seed})
        yield Task(key, group, system, Path(log).name, seed, point, (*line, "--seed", str(seed)))


def _list(path: Path, given: dict[str, Any], name: str) -> list[str]:
    values = given.get(name)
    if not isinstance(values, list) or not values or not all(isinstance(v, str) for v in values):
        raise UsageError(f"{path}: field {name!r} must be a list of names")
    return values


def _systems(path: Path, given: dict[str, Any]) -> list[str]:
    names = _list(path, given, "systems")
    for name in names:
        if name not in systems():
            raise UsageError(f"{path}: field 'systems': {name!r} is none of {', '.join(systems())}")
    return names


def _logs(path: Path, given: dict[str, Any]) -> list[str]:
    found: dict[str, None] = {}
    for pattern in _list(path, given, "logs"):
        folder = path.parent.absolute()
        here = [str(folder / name) for name in sorted(glob.glob(pattern, root_dir=folder, recursive=True))]
        files = [name for name in here if Path(name).is_file()]
        if not files:
            what = "only a folder" if here else "nothing"
            raise UsageError(f"{path}: field 'logs': {what} is called {pattern} beside it")
        found |= dict.fromkeys(files)
    return list(found)


def _seeds(path: Path, given: dict[str, Any]) -> list[int]:
    seeds = given.get("seeds", 1)
    many = list(range(seeds)) if isinstance(seeds, int) and not isinstance(seeds, bool) else seeds
    if not isinstance(many, list) or not many or not all(type(s) is int and 0 <= s <= _MOST_SEED for s in many):
        raise UsageError(f"{path}: field 'seeds' must be a number of seeds, or a list of them")
    return many


def _of(table: dict[str, Any], system: str) -> dict[str, Any]:
    """Entries for all systems, and those of this one over them."""
    own = table.get(system, {})
    return {k: v for k, v in table.items() if not isinstance(v, dict)} | (own if isinstance(own, dict) else {})


def _points(path: Path, given: dict[str, Any], system: str) -> Iterator[dict[str, Any]]:
    grid, points = given.get("grid", {}), given.get("points", [{}])
    tables = [*(points if isinstance(points, list) and points else [None]), grid, given.get("options", {})]
    if not all(isinstance(table, dict) for table in tables):
        raise UsageError(f"{path}: 'options' and 'grid' must be tables, 'points' a list of one or more")
    for table in (grid, given.get("options", {})):
        for name, value in table.items():
            if isinstance(value, dict) and name not in systems():
                raise UsageError(f"{path}: table {name!r} is named like no system")
    axes = _of(grid, system)
    for name, values in axes.items():
        if not isinstance(values, list) or not values:
            raise UsageError(f"{path}: field 'grid.{name}' must be a list of values")
    for combination in itertools.product(*axes.values()):
        for more in points:
            yield dict(zip(axes, combination, strict=True)) | more


def _words(path: Path, cli: CommandLine, system: str, options: dict[str, Any], log: Path) -> Iterator[str]:
    """Options as words of a command line; files beside the sweep file get their full path."""
    known = cli.flags(system)
    for name, value in options.items():
        flag = f"--{name.replace('_', '-')}"
        if flag[2:] in _OURS:
            raise UsageError(f"{path}: option {name!r} belongs to the sweep; see 'seeds', or pfcli batch --help")
        if not _FLAG.fullmatch(flag[2:]):
            raise UsageError(f"{path}: option {name!r} is no name of a flag")
        option = known.get(flag)
        if isinstance(value, list) and not (option and option.multiple):
            raise UsageError(f"{path}: option {name!r} takes one value; several belong into [grid]")
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, bool):
                if item:
                    yield flag
                elif option is None or option.on_off:
                    yield f"--no-{flag[2:]}"
                continue
            text = str(item).replace("{log}", str(log.with_suffix("")))
            beside = path.parent.absolute() / text
            yield from (flag, str(beside) if isinstance(item, str) and beside.is_file() else text)
