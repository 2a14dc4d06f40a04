"""localize-reliable: lost and found, unknown obstacles, classes of beams, bounds, speed; Wean Hall.

python benchmarks/reliable.py [seeds] [kidnap-logs]

Success: within 0.25 m and 5 degrees. A kidnapping is noticed when p(success) falls below 0.5; the pose is right again
when five updates in a row succeed. Truth of the classes: a beam is unknown whose end point, from the true pose, lies
farther than 0.2 m from every mapped surface.
"""

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import plain_mcl
import worlds
from scipy.stats import rankdata

from pfcli import align, run
from pfcli.core.sensor import class_conditional
from pfcli.dead_reckoning import Drive
from pfcli.formats import map_yaml, parquet
from pfcli.initial import Initial
from pfcli.loss import Loss
from pfcli.params import build
from pfcli.registry import system
from pfcli.replay import Log
from pfcli.report.metrics import wrap
from pfcli.simulate import scenario
from pfcli.systems.localize_reliable import assets

SYSTEM = system("localize-reliable")
WEAN_END = np.array([39.78, 39.81, -0.03])
CLUTTER = ("reliable-20", "reliable-40", "reliable-60")


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
        """Seconds until kidnapping k is noticed, and until the pose is right again."""
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
        job = run.Job(SYSTEM, build(SYSTEM.params, params, "b"), [log], seed, map=map_file, initial=initial)
        done = run.execute(job)
        self.seconds = time.perf_counter() - began
        rows = parquet.columns_of(done.infos, SYSTEM.info)
        at = done.result.track.columns["update"]
        super().__init__(log, np.asarray(rows["t_ns"]), done.result.track.poses[at], np.asarray(rows["p_success"]))
        self.bound = np.asarray(rows["protection_m"])
        self.loop = done.seconds["loop"] / len(done.infos)


def auroc(good: np.ndarray, p: np.ndarray) -> float:
    """Area under the curve; NaN where there is one class only."""
    ones, zeros = good.sum(), (~good).sum()
    return float((rankdata(p)[good].sum() - ones * (ones + 1) / 2) / (ones * zeros)) if ones and zeros else np.nan


def kidnappings(logs: int) -> None:
    print("| filter | kidnappings | noticed: median, 95 % [s] | right again: median, 95 %, worst [s] | AUROC | Brier |")
    print("|---|---|---|---|---|---|")
    files = kidnap_logs(logs)
    _carried(
        "localize-reliable", [Judged(f, f.with_suffix(".yaml"), k, Initial("inside")) for k, f in enumerate(files)]
    )
    _carried("augmented MCL, 5000 particles", [augmented(f, k, 5000) for k, f in enumerate(files)])


def augmented(log: Path, seed: int, particles: int) -> Poses:
    """An augmented MCL as AMCL configures it; it notices when more than a tenth of its particles are drawn anywhere."""
    grid = map_yaml.read(log.with_suffix(".yaml"))
    mcl = plain_mcl.AugmentedMcl(grid, plain_mcl.anywhere(grid, particles, np.random.default_rng(seed)), seed)
    rows = [(stamp, 0.6 - mcl.surprise, pose) for stamp, _, pose in plain_mcl.drive(mcl, log)]
    stamps, p, poses = zip(*rows, strict=True)
    return Poses(log, np.array(stamps), np.array(poses), np.array(p))


def _carried(name: str, runs: Sequence[Poses]) -> None:
    pairs = np.array([r.after(k) for r in runs for k in range(r.kidnapped.size)])
    noticed, right = (np.sort(pairs[:, k]) for k in (0, 1))
    good, p = np.concatenate([r.good for r in runs]), np.concatenate([r.p for r in runs])
    print(
        f"| {name} | {len(pairs)} | {at(noticed, 0.5):.1f}, {at(noticed, 0.95):.1f} |"
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
    for sweep in align.sweeps(Log(log).events(["odometry", "scan"]), "odometry", Drive(), Loss()):
        k = index.get(sweep.stamp_ns)
        if k is None or not judged.good[k]:
            continue
        scan, _ = assets.scan_of(sweep, params)
        model = assets.model_of(params, 30.0)
        called = class_conditional.classes(judged.pose[k], scan, field, model).p_unknown >= params.unknown_threshold
        really = class_conditional.classes(judged.truth[k], scan, field, model).away_m > 0.2
        counts += [np.sum(called & really), np.sum(called & ~really), np.sum(~called & really)]
    return counts


def drives(seeds: int) -> None:
    print(
        "\n| scenario | seeds | good | RMSE [m]: all, when good | AUROC | Brier | false alarms | bound holds |"
        " median bound [m] | ms/update |\n|---|---|---|---|---|---|---|---|---|---|"
    )
    pooled = np.zeros(3)
    for name, world, start in (
        *((n, 1, Initial("pose", (1.5, 12.25, 0.0))) for n in CLUTTER),
        ("reliable-crowd", 1, Initial("pose", (1.5, 12.25, 0.0))),
        ("slips", 1, Initial("pose", (1.5, 12.25, 0.0))),
        ("partial-symmetric", 1, Initial("inside")),
        ("wrong map", 2, Initial("inside")),
    ):
        runs = []
        for seed in range(seeds):
            log = simulated(
                "office" if name == "wrong map" else name, world if name == "wrong map" else 1 + seed * 0, seed
            )
            place = simulated("office", 1, 0) if name == "wrong map" else log
            judged = Judged(log, place.with_suffix(".yaml"), seed, start)
            runs.append(judged)
            if name in CLUTTER:
                pooled += classes(log, judged)
        join = {k: np.concatenate([getattr(r, k) for r in runs]) for k in ("good", "error", "p", "bound")}
        good, p = join["good"], join["p"]
        held = np.concatenate([(r.error <= r.bound)[r.quiet()] for r in runs])
        rmse = [
            np.sqrt(np.mean(join["error"] ** 2)),
            np.sqrt(np.mean(join["error"][good] ** 2)) if good.any() else np.nan,
        ]
        alarms = np.mean(p[good] < 0.5) if good.any() else np.nan
        print(
            f"| {name} | {seeds} | {good.mean():.3f} | {rmse[0]:.3f}, {rmse[1]:.3f} | {auroc(good, p):.3f} |"
            f" {np.mean((p - good) ** 2):.4f} | {alarms:.4f} | {held.mean():.4f} | {np.median(join['bound']):.3f} |"
            f" {1e3 * np.mean([r.loop for r in runs]):.2f} |",
            flush=True,
        )
    tp, fp, fn = pooled
    print(f"\nclass `unknown`, pooled over {', '.join(CLUTTER)}: F1 {2 * tp / (2 * tp + fp + fn):.3f}")


def wean(seeds: int) -> None:
    log = worlds.LOGS / "wean3.mcap"
    if not log.exists():
        worlds.pfcli("convert", str(worlds.DATA / "wean/robotdata3.log.gz"), str(log))
    print("\n| Wean log 3, seed | end off by [m] | [deg] | p(success) at the end |\n|---|---|---|---|")
    for seed in range(seeds):
        params = build(SYSTEM.params, {}, "b")
        job = run.Job(SYSTEM, params, [log], seed, map=worlds.DATA / "wean/wean.yaml", initial=Initial("inside"))
        done = run.execute(job)
        off = done.result.track.poses[-1] - WEAN_END
        print(
            f"| {seed} | {np.hypot(*off[:2]):.3f} | {np.degrees(wrap(off[2])):.1f} | {done.infos[-1].p_success:.3f} |",
            flush=True,
        )


def speed() -> None:
    log = simulated("office", 1, 0)
    start = Initial("pose", (1.5, 12.25, 0.0))
    print("\n| 500 particles x 60 beams | ms/update, replay included |\n|---|---|")
    for name, given in (("without the sampler", {"use_gl": False}), ("with it, every second", {})):
        loops = [Judged(log, log.with_suffix(".yaml"), 0, start, **given).loop for _ in range(3)]
        print(f"| {name} | {1e3 * min(loops[1:]):.2f} |", flush=True)


def main(seeds: int = 5, logs: int = 6) -> None:
    """All tables."""
    kidnappings(logs)
    drives(seeds)
    wean(10)
    speed()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
