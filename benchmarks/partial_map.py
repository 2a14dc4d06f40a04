"""localize-partial on simulated drives in and out of a partial map: classes, crossings, poses.

python benchmarks/partial_map.py [seeds] [corrected|filtered|paper|plain|hours|switches|slips|drives ...]

corrected: in or out given the whole log, as `localize-partial` says it; filtered, paper: given the log so far.
"""

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import partial_score
import plain_mcl
import worlds

from pfcli.core.evaluation import se2
from pfcli.formats import map_yaml
from pfcli.initial import Initial
from pfcli.params import build
from pfcli.registry import system
from pfcli.replay.log import Log
from pfcli.runs import loop
from pfcli.simulation import scenario

SCENARIOS = {
    "partial-leave": "unknown",
    "partial-enter": "outside",
    "partial-other-way": "unknown",
    "partial-loops": "unknown",
    "partial-never": "outside",
    "partial-kidnap": "unknown",
    "partial-symmetric": "unknown",
    "partial-crowd": "unknown",
    "partial-30": "unknown",
    "partial-70": "unknown",
    "partial-90": "unknown",
    "partial-furnished": "unknown",
    "partial-furnished-stay": "unknown",
}
"""Scenario -> what the robot is told of its start."""


def log_of(scenario: str, seed: int) -> tuple[Path, Path]:
    """Log and partial map."""
    path = worlds.LOGS / f"{scenario}-{seed}.mcap"
    partial = worlds.LOGS / f"{scenario}-{seed}-partial.yaml"
    if not partial.exists():
        worlds.LOGS.mkdir(parents=True, exist_ok=True)
        worlds.pfcli("simulate", scenario, str(path), "--seed", str(seed), "--partial-map", "--force")
    return path, partial


def localise(log: Path, map_file: Path, seed: int, initial: Initial, **params: Any) -> loop.Run:
    """One run of localize-partial."""
    partial = system("localize-partial")
    return loop.execute(
        loop.Job(partial, build(partial.params, params, "b"), [log], seed, map=map_file, initial=initial)
    )


LONG_OUTSIDE = ["partial-never", "partial-loops", "partial-30"]
"""Drives that are outside most of their time: what false entries an hour are counted on."""


def table(seeds: range, variant: str, scenarios: list[str], **params: Any) -> list[partial_score.Score]:
    """Print a row per scenario and the whole."""
    print(f"\n{variant} {params or ''}{partial_score.HEAD.format('scenario')}")
    every: list[partial_score.Score] = []
    confusion = np.zeros((7, 7), int)
    for name in scenarios:
        scores, ms = [], []
        for seed in seeds:
            log, map_file = log_of(name, seed)
            done = localise(log, map_file, seed, Initial(SCENARIOS[name]), variant=variant, **params)
            drive = partial_score.beside_truth(done, log, map_file)
            np.add.at(confusion, (drive.true_class, drive.said_class), 1)
            scores.append(partial_score.judge(drive))
            ms.append(drive.ms)
        print(partial_score.row(name, scores, float(np.median(ms))), flush=True)
        every += scores
    print(partial_score.row("all", every, np.nan))
    print("\ntrue class (row) against the most likely one:")
    print(confusion[1:, 1:])
    return every


SWITCHES: tuple[dict[str, Any], ...] = (
    {},
    {"smooth": True},
    {"outside_likelihood": False},
    {"model_unknown": False},
    {"history_m": 0.0},
    {"match_scans": False},
    {"kidnap_per_m": 0.0},
    {"kld": False, "particles": 10_000},
)
SWITCHED = ["partial-enter", "partial-other-way", "partial-kidnap", "partial-crowd", "partial-30"]


def switches(seeds: int) -> None:
    """What each part does, over the drives of SWITCHED together; smooth: in or out given the whole log."""
    print(partial_score.HEAD.format("switch"))
    for params in SWITCHES:
        given, scores, ms = {"smooth": False} | params, [], []
        for name in SWITCHED:
            for seed in range(seeds):
                log, map_file = log_of(name, seed)
                drive = partial_score.beside_truth(
                    localise(log, map_file, seed, Initial(SCENARIOS[name]), **given), log, map_file
                )
                scores.append(partial_score.judge(drive))
                ms.append(drive.ms)
        name = ", ".join(f"{k} = {v}" for k, v in params.items()) or "default, but no smoothing"
        print(partial_score.row(name, scores, float(np.median(ms))), flush=True)


def plain(seeds: int, particles: int = 2000) -> None:
    """A plain MCL, told its start where that lies in the map (ours is not): it knows no outside, only its pose can be right."""
    print(
        "\nplain MCL, start known\n| scenario | truly inside | right pose of the updates inside, after 10 m |\n|---|---|---|"
    )
    for name in SCENARIOS:
        shares = []
        for seed in range(seeds):
            log, map_file = log_of(name, seed)
            grid, rng = map_yaml.read(map_file), np.random.default_rng(seed)
            first = next(iter(Log(log).events(["truth"])))
            start, known = partial_score.truth_at(np.array([first.stamp_ns]), log, map_file)
            poses = plain_mcl.anywhere(grid, particles, rng)
            if known[0]:
                poses = start[0] + rng.normal(0, [0.1, 0.1, 0.05], (particles, 3))
            rows = list(plain_mcl.drive(plain_mcl.PlainMcl(grid, poses, seed), log))
            late = np.array([way for _, way, _ in rows]) >= partial_score.SETTLED_M
            if not late.any():
                continue
            found = np.array([pose for _, _, pose in rows])
            there, inside = partial_score.truth_at(np.array([t for t, _, _ in rows]), log, map_file)
            right = np.hypot(*(found - there)[:, :2].T) < partial_score.RIGHT_M
            right &= np.abs(se2.wrap(found[:, 2] - there[:, 2])) < partial_score.RIGHT_RAD
            shares.append((inside[late].mean(), right[late & inside].mean() if (late & inside).any() else np.nan))
        print(f"| {name} | {np.mean([s[0] for s in shares]):.3f} | {np.mean([s[1] for s in shares]):.3f} |", flush=True)


def slips(seeds: int) -> None:
    """A robot whose odometry jumps by 0.3 m and 15 degrees every 12 m, in and out five times."""
    print(partial_score.HEAD.format("odometry that slips"))
    slipping = scenario.SCENARIOS["partial-loops"]._replace(robot="slips")
    for params in ({}, {"match_scans": False}):
        scores, ms = [], []
        for seed in range(seeds):
            log, map_file = worlds.LOGS / f"partial-slips-{seed}.mcap", log_of("partial-loops", seed)[1]
            if not log.exists():
                scenario.write(slipping, seed, log)
            drive = partial_score.beside_truth(
                localise(log, map_file, seed, Initial("unknown"), **params), log, map_file
            )
            scores.append(partial_score.judge(drive))
            ms.append(drive.ms)
        print(partial_score.row(str(params or "default"), scores, float(np.median(ms))), flush=True)


def drives(seeds: int) -> None:
    """Zhang 2010, section 4: drive 1 gives a map by slam-gdr, drive 2 is localised in it. With a scanner of 4 m, and of 8 m."""
    print(partial_score.HEAD.format("scanner; ATE of drive 1 [m]"))
    for laser in ("urg-04lx", "sick-1deg"):
        scores, ms, ate = [], [], []
        for seed in range(seeds):
            logs = [worlds.LOGS / f"partial-drive-{k}-{laser}-{seed}.mcap" for k in (1, 2)]
            for k, log in enumerate(logs, 1):
                if not log.exists():
                    scenario.write(scenario.SCENARIOS[f"partial-drive-{k}"]._replace(laser=laser), seed, log)
            mapped = worlds.slam(logs[0], seed, truth=True)
            assert mapped.result.grid is not None
            assert mapped.errors is not None
            ate.append(mapped.errors.summary()["ate_m"])
            with tempfile.TemporaryDirectory() as folder:
                map_yaml.write(Path(folder), mapped.result.grid)
                map_file = Path(folder) / "map.yaml"
                drive = partial_score.beside_truth(
                    localise(logs[1], map_file, seed, Initial("unknown")), logs[1], map_file
                )
            scores.append(partial_score.judge(drive))
            ms.append(drive.ms)
        print(partial_score.row(f"{laser}; {np.median(ate):.3f}", scores, float(np.median(ms))), flush=True)


def main(seeds: int = 10, *variants: str) -> None:
    """Both variants, and a plain MCL; `hours`: more drives outside, seeds from ten on; the others as their functions say."""
    for variant in variants or ("corrected", "filtered", "paper", "plain"):
        if variant == "plain":
            plain(seeds)
        elif variant == "hours":
            table(range(10, 10 + seeds), "corrected", LONG_OUTSIDE)
        elif variant in ("switches", "slips", "drives"):
            {"switches": switches, "slips": slips, "drives": drives}[variant](seeds)
        else:
            of_system = "paper" if variant == "paper" else "corrected"
            table(range(seeds), of_system, list(SCENARIOS), smooth=variant == "corrected")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10, *sys.argv[2:])
