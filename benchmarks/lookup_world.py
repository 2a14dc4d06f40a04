"""localize-lookup on the paper's world: updates until the filter has converged, against the classic filter.

python benchmarks/lookup_world.py success [seeds-laser] [seeds-finders] | particles [seeds] | pictures

Converged: 80 % of the mass within 0.3 m and 10 degrees of the truth, and so in the next update. Every seed starts at
another place of the drive. The classic filter draws headings at random and casts its rays on the spot.
"""

import sys
from typing import Any

import numpy as np
import worlds

from pfcli import align, run
from pfcli.core.weights import normalize
from pfcli.events import Sounding, Sweep
from pfcli.initial import Initial
from pfcli.params import build
from pfcli.registry import system
from pfcli.replay import Log, Loss
from pfcli.report.metrics import wrap
from pfcli.rng import Draw
from pfcli.simulate.scenario import TICKS_PER_TURN, WHEEL_RADIUS_M

LOOKUP = system("localize-lookup")
DRIVE = align.Drive(None, WHEEL_RADIUS_M, WHEEL_RADIUS_M, 0.33)
FILTERS: dict[str, dict[str, Any]] = {
    "corrected": {"start_density_per_m2": 0.0},
    "paper": {"variant": "paper"},
    "classic": {"variant": "paper", "headings": "random", "ranges": "rays"},
}
MOST = 60
assert TICKS_PER_TURN


class World:
    """A drive: its readings with odometry, and the truth at each."""

    def __init__(self, scenario: str, kind: str) -> None:
        self.log = worlds.simulated(scenario)
        motion = "encoders" if Log(self.log).choose("encoders") else "odometry"
        events = list(Log(self.log).events([motion, kind, "truth"]))
        truth = {e.stamp_ns: np.array(e[1:4]) for e in events if type(e).__name__ == "Truth"}
        readings = align.sweeps((e for e in events if type(e).__name__ != "Truth"), motion, DRIVE, Loss())
        self.readings: list[Sweep | Sounding] = [r for r in readings if r.stamp_ns in truth]
        self.truth = [truth[r.stamp_ns] for r in self.readings]


def load(world: World, params: Any) -> Any:
    job = run.Job(LOOKUP, params, [world.log], map=world.log.with_suffix(".yaml"), initial=Initial("inside"))
    return LOOKUP.load(params, job)


def near(poses: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return (np.hypot(*(poses - truth)[:, :2].T) <= 0.3) & (np.abs(wrap(poses[:, 2] - truth[2])) <= np.radians(10))


def updates_needed(
    world: World, assets: Any, params: Any, seed: int, most: int = MOST, first: int | None = None
) -> int:
    """Updates until converged (1: with the first reading), most + 1 if not within `most`."""
    at = int(np.random.default_rng(seed).integers(len(world.readings) * 3 // 4)) if first is None else first
    draw, state, count, before = Draw(seed), None, 0, False
    for reading, truth in zip(world.readings[at:], world.truth[at:], strict=True):
        if state is None:
            state = LOOKUP.init(params, assets, reading, draw)
        state, info = LOOKUP.step(state, reading, assets, params, draw)
        if info is None:
            continue
        count += 1
        weights, _ = normalize(state.log_w)
        good = weights[near(state.pose, truth)].sum() >= 0.8
        if good and before:
            return count - 1
        if count > most:
            break
        before = bool(good)
    return most + 1


def success(seeds_laser: int = 1000, seeds_finders: int = 200) -> None:
    print("| world | sensor | filter | seeds | within 6 updates | within 12 | within 60 | median | loop [ms/update] |")
    print("|---|---|---|---|---|---|---|---|---|")
    for scenario in ("four-rooms", "four-rooms-same"):
        for kind, seeds in (("scan", seeds_laser), ("range", seeds_finders)):
            world = World(scenario, kind)
            for name, given in FILTERS.items():
                params = build(LOOKUP.params, given, name)
                assets = load(world, params)
                n = np.array([updates_needed(world, assets, params, seed) for seed in range(seeds)])
                shares = " | ".join(f"{np.mean(n <= k):.3f}" for k in (6, 12, MOST))
                print(f"| {scenario} | {kind} | {name} | {seeds} | {shares} | {np.median(n):.0f} | |", flush=True)


def particles(seeds: int = 100) -> None:
    """Smallest number of particles that succeeds within 30 updates in 95 % of the seeds, and the curve."""
    print("| sensor | filter | " + " | ".join(map(str, COUNTS)) + " |\n|---" * 1)
    for kind in ("scan", "range"):
        world = World("four-rooms", kind)
        for name, given in FILTERS.items():
            row = []
            for n in COUNTS:
                params = build(LOOKUP.params, given | {"particles": n}, name)
                assets = load(world, params)
                found = [updates_needed(world, assets, params, seed, 30) for seed in range(seeds)]
                row.append(np.mean(np.array(found) <= 30))
            print(f"| {kind} | {name} | " + " | ".join(f"{v:.2f}" for v in row) + " |", flush=True)


COUNTS = (50, 100, 200, 350, 700, 1400, 3500, 7000, 14000, 28000)

if __name__ == "__main__":
    task, *rest = sys.argv[1:]
    {"success": success, "particles": particles}[task](*map(int, rest))
