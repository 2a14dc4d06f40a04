"""localize-reliable in simulation: lost and found, unknown obstacles, classes of beams, bounds, its switches, speed.

python benchmarks/reliable.py kidnapped LOGS | drives SEEDS | plain SEEDS | switches SEEDS | steps LOGS | speed

Success: within 0.25 m and 5 degrees. A kidnapping is noticed when p(success) falls below 0.5 or the estimate jumps to the
right pose, whichever is first; the pose is right again when five updates in a row succeed. Truth of the classes: a beam is
unknown whose end point, from the true pose, lies farther than 0.2 m from every mapped surface.
"""

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import plain_mcl
import worlds

from pfcli.core.evaluation.se2 import wrap
from pfcli.core.sensor import class_conditional
from pfcli.dropped import Dropped
from pfcli.formats import map_yaml, parquet
from pfcli.initial import Initial
from pfcli.params import build
from pfcli.registry import filter_of, system
from pfcli.replay import align
from pfcli.replay.log import Log
from pfcli.replay.settings import Drive
from pfcli.runs import loop
from pfcli.simulation import scenario
from pfcli.systems.localize_reliable import map_models

SYSTEM = system("localize-reliable")
CLUTTER = ("reliable-20", "reliable-40", "reliable-60")
START = Initial("pose", (1.5, 12.25, 0.0))


def simulated(name: str, world_seed: int, seed: int) -> Path:
    """A log with its map, of another plan of boxes or other kidnappings by `world_seed`."""
    path = worlds.LOGS / f"{name}-{world_seed}-{seed}.mcap"
    if not path.exists():
        worlds.LOGS.mkdir(parents=True, exist_ok=True)
        found = scenario.SCENARIOS[name]._replace(world_seed=world_seed)
        scenario.write(found, seed, path)
        scenario.write_map(found, path.parent, path.stem)
    return path


class Poses:
    """What a filter said at its updates, against truth: stamps (ns), poses, p(success) or what stands for it."""

    def __init__(self, log: Path, stamps: np.ndarray, pose: np.ndarray, p: np.ndarray) -> None:
        truth = {e.stamp_ns: np.array(e[1:4]) for e in Log(log).events(["truth"])}
        self.stamps, self.pose, self.p = stamps, pose, p
        self.truth = np.array([truth[t] for t in stamps.tolist()])
        self.error = np.hypot(*(pose - self.truth)[:, :2].T)
        self.good = (self.error <= 0.25) & (np.abs(wrap(pose[:, 2] - self.truth[:, 2])) <= np.radians(5))
        self.kidnapped = np.flatnonzero(np.hypot(*np.diff(self.truth[:, :2], axis=0).T) > 1.0) + 1

    def after(self, k: int) -> tuple[float, float]:
        """Seconds until p(success) falls below 0.5 after kidnapping k, and until the pose is right again."""
        first = self.kidnapped[k]
        last = self.kidnapped[k + 1] if k + 1 < self.kidnapped.size else self.stamps.size
        since = (self.stamps[first:last] - self.stamps[first]) * 1e-9
        low = np.flatnonzero(self.p[first:last] < 0.5)
        right = [i for i in range(since.size - 4) if self.good[first + i : first + i + 5].all()]
        return float(since[low[0]]) if low.size else np.inf, float(since[right[0]]) if right else np.inf

    def quiet(self) -> np.ndarray:
        """Updates outside the 3 s after a kidnapping and after the start."""
        out = self.stamps - self.stamps[0] > 3e9
        for first in self.kidnapped:
            out &= (self.stamps < self.stamps[first]) | (self.stamps > self.stamps[first] + 3e9)
        return np.asarray(out)


class Judged(Poses):
    """One run of localize-reliable."""

    def __init__(self, log: Path, map_file: Path, seed: int, initial: Initial, **params: Any) -> None:
        began = time.perf_counter()
        job = loop.Job(SYSTEM, build(SYSTEM.params, params, "b"), [log], seed, map=map_file, initial=initial)
        done = loop.execute(job)
        self.seconds = time.perf_counter() - began
        rows = parquet.columns_of(done.infos, filter_of(SYSTEM).info)
        at = done.result.track.columns["update"]
        super().__init__(log, np.asarray(rows["t_ns"]), done.result.track.poses[at], np.asarray(rows["p_success"]))
        self.bound = np.asarray(rows["protection_m"])
        self.loop = done.seconds["loop"] / len(done.infos)


def auroc(good: np.ndarray, p: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Area under the curve of weighted cases; NaN where there is one class only."""
    w = np.ones(p.size) if weight is None else weight
    ones, zeros = (w * good).sum(), (w * ~good).sum()
    if not (ones and zeros):
        return np.nan
    values, at = np.unique(p, return_inverse=True)
    bad = np.bincount(at, w * ~good, values.size)
    below = np.cumsum(bad) - bad / 2
    return float((w * good * below[at]).sum() / (ones * zeros))


def kidnapped(logs: int, **params: Any) -> list[Judged]:
    """Kidnappings every minute, unknown start; an augmented MCL beside it unless a switch is tried."""
    if not params:
        print("| filter | kidnappings | p(success) < 0.5 after, median, 95 % [s] | noticed: median, 95 % [s] |", end="")
        print(" right again: median, 95 %, worst [s] | AUROC | Brier |\n|---|---|---|---|---|---|---|")
    files = kidnap_logs(logs)
    runs = [Judged(f, f.with_suffix(".yaml"), k, Initial("inside"), **params) for k, f in enumerate(files)]
    _carried(", ".join(f"{k} = {v}" for k, v in params.items()) or "localize-reliable", runs)
    if not params:
        _carried("augmented MCL, 5000 particles", [augmented(f, k, 5000) for k, f in enumerate(files)])
    return runs


def augmented(log: Path, seed: int, particles: int) -> Poses:
    """An augmented MCL as AMCL configures it; it notices when more than a tenth of its particles are drawn anywhere."""
    grid = map_yaml.read(log.with_suffix(".yaml"))
    mcl = plain_mcl.AugmentedMcl(grid, plain_mcl.anywhere(grid, particles, np.random.default_rng(seed)), seed)
    rows = [(stamp, 0.6 - mcl.surprise, pose) for stamp, _, pose in plain_mcl.drive(mcl, log)]
    stamps, p, poses = zip(*rows, strict=True)
    return Poses(log, np.array(stamps), np.array(poses), np.array(p))


def _carried(name: str, runs: Sequence[Poses]) -> None:
    pairs = np.array([r.after(k) for r in runs for k in range(r.kidnapped.size)])
    doubted, right = (np.sort(pairs[:, k]) for k in (0, 1))
    noticed = np.sort(pairs.min(axis=1))
    good, p = np.concatenate([r.good for r in runs]), np.concatenate([r.p for r in runs])
    print(
        f"| {name} | {len(pairs)} | {at(doubted, 0.5):.1f}, {at(doubted, 0.95):.1f} |"
        f" {at(noticed, 0.5):.1f}, {at(noticed, 0.95):.1f} |"
        f" {at(right, 0.5):.1f}, {at(right, 0.95):.1f}, {right[-1]:.1f} | {auroc(good, p):.3f} |"
        f" {np.mean((p - good) ** 2):.4f} |",
        flush=True,
    )


def kidnap_logs(logs: int) -> list[Path]:
    return [simulated("reliable-kidnap", 1 + k, k) for k in range(logs)]


def at(values: np.ndarray, share: float) -> float:
    """Order statistic that `share` of the sorted values reach (infinite ones included)."""
    return float(values[min(values.size - 1, int(np.ceil(share * values.size)) - 1)])


def classes(log: Path, judged: Judged) -> np.ndarray:
    """True positives, false positives, false negatives of `unknown`, over the updates that succeed."""
    params = build(SYSTEM.params, {}, "b")
    grid = map_yaml.read(log.with_suffix(".yaml"))
    field = class_conditional.build(grid.cells, grid.resolution_m, grid.origin)
    counts = np.zeros(3)
    index = {int(t): k for k, t in enumerate(judged.stamps)}
    for sweep in align.sweeps(Log(log).events(["odometry", "scan"]), "odometry", Drive(), Dropped()):
        k = index.get(sweep.stamp_ns)
        if k is None or not judged.good[k]:
            continue
        used = map_models.usable_scan(sweep, params)
        assert used is not None, "updates have usable beams"
        scan = used.scan
        model = map_models.model_of(params, 30.0)
        called = class_conditional.classes(judged.pose[k], scan, field, model).p_unknown >= params.unknown_threshold
        really = class_conditional.classes(judged.truth[k], scan, field, model).away_m > 0.2
        counts += [np.sum(called & really), np.sum(called & ~really), np.sum(~called & really)]
    return counts


class Place(NamedTuple):
    """A drive, the map in which it is localised, what the robot is told of its start, and whether it counts among all."""

    name: str
    log: str
    world_seed: int
    map_of: tuple[str, int] | None
    start: Initial
    counts: bool


DRIVES = (
    Place("nothing unknown", "office", 1, None, START, True),
    *(Place(name, name, 1, None, START, True) for name in (*CLUTTER, "reliable-crowd", "slips")),
    Place("kidnappings", "reliable-kidnap", 1, None, Initial("inside"), True),
    Place("wrong map: another floor", "office", 2, ("office", 1), Initial("inside"), True),
    Place("wrong map: another building", "office", 1, ("paper-60x50-long", 1), Initial("inside"), True),
    Place("symmetric corridor (apart)", "partial-symmetric", 1, None, Initial("inside"), False),
)
"""Another floor: the same walls, other doors and furniture."""
HARD = [p for p in DRIVES if p.log in ("reliable-60", "reliable-crowd", "slips") or p.name.endswith("floor")]


def run_of(place: Place, seed: int, **params: Any) -> tuple[Path, Judged]:
    """One drive."""
    log = simulated(place.log, place.world_seed, seed)
    other = log if place.map_of is None else simulated(*place.map_of, 0)
    return log, Judged(log, other.with_suffix(".yaml"), seed, place.start, **params)


def drives(seeds: int, **params: Any) -> None:
    """A row a scenario, and all that count with equal weights; held: share of the updates outside the 3 s after a
    kidnapping at which the bound holds, with a bootstrap over blocks of 10 s."""
    print(
        f"\n{params or ''}\n| scenario, {seeds} seeds | good | RMSE [m]: all, when good | AUROC | Brier | false alarms |"
        " bound holds (95 %) | median bound [m], by RMSE when good |\n|---|---|---|---|---|---|---|---|"
    )
    pooled, parts = np.zeros(3), []
    for place in DRIVES:
        runs = []
        for seed in range(seeds):
            log, judged = run_of(place, seed, **params)
            runs.append(judged)
            if place.name in CLUTTER:
                pooled += classes(log, judged)
        good, p, error, bound = (np.concatenate([getattr(r, k) for r in runs]) for k in ("good", "p", "error", "bound"))
        held = [(r.error <= r.bound)[r.quiet()] for r in runs]
        low, high = blocks(held)
        when = np.sqrt(np.mean(error[good] ** 2)) if good.any() else np.nan
        alarms = np.mean(p[good] < 0.5) if good.any() else 0.0
        print(
            f"| {place.name} | {good.mean():.3f} | {np.sqrt(np.mean(error**2)):.3f}, {when:.3f} |"
            f" {auroc(good, p):.3f} | {np.mean((p - good) ** 2):.4f} | {alarms:.4f} |"
            f" {np.concatenate(held).mean():.4f} ({low:.4f}-{high:.4f}) |"
            f" {np.median(bound):.3f}, {np.median(bound) / when:.1f} |",
            flush=True,
        )
        if place.counts:
            parts.append((good, p))
    good, p = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    weight = np.concatenate([np.full(part[0].size, 1.0 / part[0].size) for part in parts])
    brier, alarms = np.average((p - good) ** 2, weights=weight), np.average((p < 0.5)[good], weights=weight[good])
    print(f"| all, equal weights | | | {auroc(good, p, weight):.3f} | {brier:.4f} | {alarms:.4f} | | |")
    tp, fp, fn = pooled
    print(f"\nclass `unknown`, pooled over {', '.join(CLUTTER)}: F1 {2 * tp / (2 * tp + fp + fn):.3f}")


def blocks(runs: list[np.ndarray], length: int = 50) -> tuple[float, float]:
    """95 % interval of a share by a bootstrap over blocks of updates (10 s of driving)."""
    cut = [b for r in runs for b in np.array_split(r, max(1, r.size // length)) if b.size]
    sums, sizes = np.array([b.sum() for b in cut]), np.array([b.size for b in cut])
    pick = np.random.default_rng(0).integers(len(cut), size=(2000, len(cut)))
    low, high = np.quantile(sums[pick].sum(axis=1) / sizes[pick].sum(axis=1), [0.025, 0.975])
    return float(low), float(high)


def plain(seeds: int, particles: int = 2000) -> None:
    """A plain MCL on the same drives, told its start."""
    print("\n| scenario | plain MCL, 2000 particles: good | RMSE [m]: all, when good |\n|---|---|---|")
    for place in DRIVES[:6]:
        runs = []
        for seed in range(seeds):
            log, rng = simulated(place.log, place.world_seed, seed), np.random.default_rng(seed)
            poses = np.array(START.pose) + rng.normal(0, [0.1, 0.1, 0.05], (particles, 3))
            mcl = plain_mcl.PlainMcl(map_yaml.read(log.with_suffix(".yaml")), poses, seed)
            stamps, pose = zip(*((t, x) for t, _, x in plain_mcl.drive(mcl, log)), strict=True)
            runs.append(Poses(log, np.array(stamps), np.array(pose), np.ones(len(stamps))))
        good, error = np.concatenate([r.good for r in runs]), np.concatenate([r.error for r in runs])
        when = np.sqrt(np.mean(error[good] ** 2)) if good.any() else np.nan
        print(f"| {place.name} | {good.mean():.3f} | {np.sqrt(np.mean(error**2)):.3f}, {when:.3f} |", flush=True)


SWITCHES: tuple[dict[str, Any], ...] = (
    {},
    {"track_record": False},
    {"map_changes": False},
    {"new_only": False},
    {"evidence_top": 1e6},
    {"decision_weighs": True},
    {"rivals": 0},
    {"match_samples": 100},
    {"range_model": "beam"},
    {"gl_gate": True},
    {"use_gl": False},
    {"estimate_reliability": False},
)


def switches(seeds: int) -> None:
    """What each part does: kidnappings on `seeds` logs, and drives."""
    print(
        "| switch | kidnapped: right again 95 % [s], AUROC | " + " | ".join(p.name for p in HARD),
        end=" |\n",
    )
    print("|---" * 6 + "|")
    for params in SWITCHES:
        runs = [
            Judged(f, f.with_suffix(".yaml"), k, Initial("inside"), **params) for k, f in enumerate(kidnap_logs(seeds))
        ]
        right = np.sort([r.after(k)[1] for r in runs for k in range(r.kidnapped.size)])
        good, p = np.concatenate([r.good for r in runs]), np.concatenate([r.p for r in runs])
        cells = [f"{at(right, 0.95):.1f}, {auroc(good, p):.3f}"]
        for place in HARD:
            runs = [run_of(place, seed, **params)[1] for seed in range(seeds)]
            good, p, error = (np.concatenate([getattr(r, k) for r in runs]) for k in ("good", "p", "error"))
            cells.append(f"{good.mean():.3f}, {np.sqrt(np.mean(error**2)):.3f} m, {np.mean((p - good) ** 2):.3f}")
        print(
            f"| {', '.join(f'{k} = {v}' for k, v in params.items()) or 'default'} | " + " | ".join(cells) + " |",
            flush=True,
        )


def steps(logs: int) -> None:
    """The global sampler by the number of earlier key scans that it joins."""
    print(
        "| N | kidnappings | p(success) < 0.5 after [s] | noticed [s] | right again: median, 95 %, worst [s] | AUROC | Brier |"
    )
    print("|---|---|---|---|---|---|---|")
    for n in (0, 1, 2, 5, 10):
        kidnapped(logs, gl_steps=n)


def speed() -> None:
    log = simulated("office", 1, 0)
    print("\n| 500 particles x 60 beams | ms/update, replay included |\n|---|---|")
    for name, given in (("without the sampler", {"use_gl": False}), ("with it, every second", {})):
        loops = [Judged(log, log.with_suffix(".yaml"), 0, START, **given).loop for _ in range(3)]
        print(f"| {name} | {1e3 * min(loops[1:]):.2f} |", flush=True)


PARTS = {"kidnapped": kidnapped, "drives": drives, "plain": plain, "switches": switches, "steps": steps}


def main(part: str = "drives", count: str = "2") -> None:
    """One table."""
    if part == "speed":
        speed()
    else:
        PARTS[part](int(count))


if __name__ == "__main__":
    main(*sys.argv[1:])
