"""What a batch found: a row for every job, groups of seeds, and what differs from another batch."""

import json
import math
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from pfcli.errors import LogError, reason
from pfcli.formats import parquet

_GIVEN = ("job", "group", "system", "log", "seed", "exit")
_ROWS = 4096


class Group(NamedTuple):
    """Jobs that differ in nothing but the seed. mark: hash of the log and of all options that were given."""

    system: str
    log: str
    point: tuple[tuple[str, str], ...]
    mark: str


class Spread(NamedTuple):
    """Of a metric over seeds: how many, mean, median, and the 95 % interval of the mean by Student's t."""

    n: int
    mean: float
    median: float
    low: float
    high: float


def rows(folder: Path) -> Iterator[dict[str, Any]]:
    """A row for every job that is done, in the order of their keys; numbers of run.json under their path's names. Raises
    LogError."""
    jobs = folder / "jobs"
    if not jobs.is_dir():
        raise LogError(f"{folder}: is no folder of pfcli batch: it has no jobs")
    for key in sorted(entry.name for entry in os.scandir(jobs) if not entry.name.startswith(".")):
        try:
            record, ran = (json.loads((jobs / key / name).read_text()) for name in ("job.json", "run.json"))
            row = {
                "job": key,
                **{k: record[k] for k in _GIVEN[1:]},
                **{f"point.{k}": v for k, v in record["point"].items()},
            }
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise LogError(
                f"{jobs / key}: is no folder of a job ({reason(error)}); delete it and run the batch again"
            ) from None
        yield row | dict(_numbers(ran))


def failures(folder: Path) -> list[dict[str, Any]]:
    """Records of the jobs that failed. Raises LogError."""
    found = []
    for path in sorted((folder / "failed").glob("*.json")):
        try:
            record = json.loads(path.read_text())
            found.append({k: record[k] for k in ("system", "log", "seed", "point", "why")})
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise LogError(f"{path}: is no record of a job ({reason(error)}); delete it") from None
    return found


def _numbers(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    for name, value in table.items():
        if isinstance(value, dict):
            yield from _numbers(value, f"{prefix}{name}.")
        elif isinstance(value, int | float) and name != "seed":
            yield f"{prefix}{name}", float(value)


def write(folder: Path, target: Path) -> list[str]:
    """Write all rows into a Parquet file, some thousand at a time, in two passes: the first finds the columns. Returns the names
    of its numbers."""
    numbers: dict[str, None] = {}
    points: dict[str, None] = {}
    for row in rows(folder):
        for name in row:
            if name not in _GIVEN:
                (points if name.startswith("point.") else numbers).setdefault(name)
    names = [*_GIVEN, *sorted(points), *sorted(numbers)]
    kinds = dict.fromkeys((*_GIVEN[:4], *points), "text") | {"seed": "int", "exit": "int"}
    with parquet.rows_writer(target, {name: kinds.get(name, "float") for name in names}) as out:
        batch: list[dict[str, Any]] = []
        for row in rows(folder):
            batch.append({k: str(v) if kinds.get(k) == "text" else v for k, v in row.items()})
            if len(batch) == _ROWS:
                out(batch)
                batch = []
        out(batch)
    return sorted(numbers)


def groups(table: Iterable[dict[str, Any]], metric: str, where: Path) -> dict[Group, dict[int, float]]:
    """Value of a metric by group and seed, NaN where a run has none; table: rows of a folder, or of the file made of it. Raises
    LogError where two jobs are of the same seed."""
    found: dict[Group, dict[int, float]] = {}
    for row in table:
        given = ((k, v) for k, v in sorted(row.items()) if k.startswith("point.") and v is not None)
        point = tuple((k.removeprefix("point."), str(v)) for k, v in given)
        group = found.setdefault(Group(row["system"], row["log"], point, row["group"]), {})
        if row["seed"] in group:
            twice = f"{row['system']} on {row['log']} with seed {row['seed']}"
            why = "pfcli, or a file that they name, changed between them"
            raise LogError(f"{where}: holds {twice} and the same options twice: {why}; give each its own --out")
        value = row.get(metric)
        group[row["seed"]] = value if value is not None and math.isfinite(value) else math.nan
    return dict(sorted(found.items()))


def spread(values: list[float]) -> Spread:
    """Of the values of a group that are numbers."""
    v = np.array([value for value in values if not math.isnan(value)])
    if v.size == 0:
        return Spread(0, math.nan, math.nan, math.nan, math.nan)
    mean, half = float(v.mean()), float("nan")
    if v.size > 1:
        half = float(stdtrit(v.size - 1, 0.975) * v.std(ddof=1) / math.sqrt(v.size))
    return Spread(v.size, mean, float(np.median(v)), mean - half, mean + half)


def best(found: dict[Group, dict[int, float]], *, higher: bool) -> dict[str, tuple[tuple[tuple[str, str], ...], float]]:
    """The parameters with the best mean over logs, of each system that was run with several."""
    means: dict[str, dict[tuple[tuple[str, str], ...], list[float]]] = {}
    for group, values in found.items():
        means.setdefault(group.system, {}).setdefault(group.point, []).append(spread(list(values.values())).mean)
    out = {}
    for system, by_point in means.items():
        if len(by_point) > 1:
            order = {p: (-1 if higher else 1) * float(np.mean(v)) for p, v in by_point.items()}
            point = min(by_point, key=lambda p: math.inf if math.isnan(order[p]) else order[p])
            out[system] = point, float(np.mean(by_point[point]))
    return out


class Change(NamedTuple):
    """A group of the baseline: means of the seeds that both batches have a number for, the change as a share of the old mean
    (negative: better), and the seeds that only the baseline has a number for."""

    group: Group
    seeds: int
    old: float
    new: float
    worse: float
    missing: tuple[int, ...]


def changes(now: dict[Group, dict[int, float]], before: dict[Group, dict[int, float]], *, higher: bool) -> list[Change]:
    """What became of the groups of the baseline, the worst first."""
    out = []
    for group, old_values in before.items():
        old_known = {seed for seed, v in old_values.items() if not math.isnan(v)}
        new_values = now.get(group, {})
        seeds = sorted(s for s in old_known if not math.isnan(new_values.get(s, math.nan)))
        missing = tuple(sorted(old_known - set(seeds)))
        if not seeds:
            out.append(Change(group, 0, math.nan, math.nan, math.nan, missing))
            continue
        old, new = (float(np.mean([values[s] for s in seeds])) for values in (old_values, new_values))
        difference = old - new if higher else new - old
        share = 0.0 if difference == 0.0 else difference / abs(old) if old else math.copysign(math.inf, difference)
        out.append(Change(group, len(seeds), old, new, share, missing))
    return sorted(out, key=lambda c: (not c.missing, -c.worse, c.group))
