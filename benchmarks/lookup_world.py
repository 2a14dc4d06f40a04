"""localize-lookup on the paper's world: updates until the filter has converged, against the classic filter.

python benchmarks/lookup_world.py success [seeds-laser] [seeds-finders]
python benchmarks/lookup_world.py particles [seeds]
python benchmarks/lookup_world.py pictures FILE

Converged: 80 % of the mass within 0.3 m and 10 degrees of the truth, and so in the next update. Every seed starts at
another place of the drive. In the world of equal rooms updates count from the first view that tells the true place from
all its images: two beams of a scan (one of two range finders) differ by more than 0.3 m. The classic filter
draws headings at random and casts its rays on the spot.
"""

import sys
from typing import Any

import numpy as np
import worlds

from pfcli.core.evaluation.se2 import wrap
from pfcli.core.geometry import compose
from pfcli.core.grid import raycast
from pfcli.core.weights import normalize
from pfcli.dropped import Dropped
from pfcli.events import Sounding, Sweep
from pfcli.initial import Initial
from pfcli.params import build
from pfcli.registry import filter_of, system
from pfcli.replay import align
from pfcli.replay.log import Log
from pfcli.replay.settings import Drive
from pfcli.rng import Draw
from pfcli.runs import loop
from pfcli.simulation.scenario import WHEEL_RADIUS_M
from pfcli.systems.localize_lookup.reading_beams import beams_of

LOOKUP = system("localize-lookup")
DRIVE = Drive(radius_m=(WHEEL_RADIUS_M,), track_m=0.33)
FILTERS: dict[str, dict[str, Any]] = {
    "corrected": {"start_density_per_m2": 0.0},
    "paper": {"variant": "paper"},
    "classic": {"variant": "paper", "headings": "random", "ranges": "rays"},
}
MOST = 60
CURVE = (1, 2, 4, 6, 9, 12, 20, 30, MOST)
"""Updates within which the share of success is told."""


class World:
    """A drive: its readings with odometry, and the truth at each."""

    def __init__(self, scenario: str, kind: str) -> None:
        self.log = worlds.simulated(scenario)
        motion = "encoders" if Log(self.log).choose("encoders") else "odometry"
        events = list(Log(self.log).events([motion, kind, "truth"]))
        truth = {e.stamp_ns: np.array(e[1:4]) for e in events if type(e).__name__ == "Truth"}
        readings = align.sweeps((e for e in events if type(e).__name__ != "Truth"), motion, DRIVE, Dropped())
        self.readings: list[Sweep | Sounding] = [r for r in readings if r.stamp_ns in truth]
        self.truth = [truth[r.stamp_ns] for r in self.readings]


def images(pose: np.ndarray) -> list[np.ndarray]:
    """Where the plan of equal rooms looks alike: the next room, turned by 180 degrees, both."""
    x, y, yaw = pose
    shift = 6.0 if x < 6.0 else -6.0
    moved = [np.array([x + shift, y, yaw])] if abs(y - 5.0) > 1.0 else []
    return moved + [np.array([12.0 - p[0], 10.0 - p[1], p[2] + np.pi]) for p in [pose, *moved]]


def tells(world: World, assets: Any, params: Any) -> np.ndarray:
    """Which readings' true views differ from those of all images."""
    rays = assets.rays

    def view(pose: np.ndarray, beams: Any) -> np.ndarray:
        mounts = np.repeat(beams.mounts, np.diff(beams.start), axis=0)
        sensor = compose(pose[None], mounts)
        at = (sensor[:, :2] - np.array(assets.grid.origin[:2])) / assets.grid.resolution_m
        return raycast.cast_many(rays.room, rays.cells, at, pose[2] + 2 * np.pi * beams.turn, 160.0) * 0.05

    found = []
    for reading, truth in zip(world.readings, world.truth, strict=True):
        beams: Any = beams_of(reading, params)
        mine = view(truth, beams)
        off = [np.sum(np.abs(np.minimum(view(i, beams), 8.0) - np.minimum(mine, 8.0)) > 0.3) for i in images(truth)]
        found.append(min(off) >= min(2, mine.size // 2))
    return np.array(found)


def load(world: World, params: Any) -> Any:
    job = loop.Job(LOOKUP, params, [world.log], map=world.log.with_suffix(".yaml"), initial=Initial("inside"))
    return filter_of(LOOKUP).load(params, job)


def near(poses: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return (np.hypot(*(poses - truth)[:, :2].T) <= 0.3) & (np.abs(wrap(poses[:, 2] - truth[2])) <= np.radians(10))


def updates_needed(
    world: World, assets: Any, params: Any, seed: int, most: int = MOST, telling: np.ndarray | None = None
) -> int:
    """Updates until converged (1: with the first reading that tells), most + 1 if not within `most`."""
    at = int(np.random.default_rng(seed).integers(len(world.readings) * 3 // 4))
    draw, state, count, before, told = Draw(seed), None, 0, False, telling is None
    for k in range(at, len(world.readings)):
        reading, truth = world.readings[k], world.truth[k]
        told = told or (telling is not None and bool(telling[k]))
        if state is None:
            state = filter_of(LOOKUP).init(params, assets, reading, draw)
        state, info = filter_of(LOOKUP).step(state, reading, assets, params, draw)
        if info is None:
            continue
        count += told
        weights, _ = normalize(state.log_w)
        good = weights[near(state.pose, truth)].sum() >= 0.8
        if good and before:
            return max(1, count - 1)
        if count > most:
            break
        before = bool(good)
    return most + 1


def success(seeds_laser: int = 1000, seeds_finders: int = 200) -> None:
    print("| world | sensor | filter | seeds |" + "".join(f" {k} |" for k in CURVE) + " median |")
    print("|---|---|---|---|---" + "|---" * len(CURVE) + "|")
    for scenario in ("four-rooms", "four-rooms-same"):
        for kind, seeds in (("scan", seeds_laser), ("range", seeds_finders)):
            world = World(scenario, kind)
            for name, given in FILTERS.items():
                params = build(LOOKUP.params, given, name)
                assets = load(world, params)
                telling = tells(world, assets, params) if scenario.endswith("same") else None
                n = np.array([updates_needed(world, assets, params, s, MOST, telling) for s in range(seeds)])
                shares = " | ".join(f"{np.mean(n <= k):.3f}" for k in CURVE)
                print(f"| {scenario} | {kind} | {name} | {seeds} | {shares} | {np.median(n):.0f} |", flush=True)


def particles(seeds: int = 100) -> None:
    """Smallest number of particles that succeeds within 30 updates in 95 % of the seeds, and the curve."""
    print("| sensor | filter | " + " | ".join(map(str, COUNTS)) + " |")
    print("|---|---" + "|---" * len(COUNTS) + "|")
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


def pictures(file: str) -> None:
    """Particles and the best pose after updates 1, 2, 4 and 6, as fig. 7: two range finders, the printed variant."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    world = World("four-rooms", "range")
    params = build(LOOKUP.params, FILTERS["paper"], "p")
    assets, draw, state, count = load(world, params), Draw(3), None, 0
    grid = assets.grid
    extent = (
        *(grid.origin.x_m, grid.origin.x_m + grid.cells.shape[1] * 0.05),
        *(grid.origin.y_m, grid.origin.y_m + grid.cells.shape[0] * 0.05),
    )
    figure, axes = plt.subplots(2, 2, figsize=(10, 8.4), constrained_layout=True)
    shown = iter(axes.ravel())
    for reading, truth in zip(world.readings[30:], world.truth[30:], strict=True):
        if state is None:
            state = filter_of(LOOKUP).init(params, assets, reading, draw)
        state, info = filter_of(LOOKUP).step(state, reading, assets, params, draw)
        count += info is not None
        if info is None or count not in (1, 2, 4, 6):
            continue
        axis, best = next(shown), state.track._poses.last()
        axis.imshow(1 - (grid.cells == 1), cmap="gray", origin="lower", extent=extent)
        axis.scatter(*state.pose[:, :2].T, s=2, color="tab:blue", alpha=0.4)
        for pose, colour in ((truth, "tab:green"), (best, "tab:red")):
            axis.plot(*pose[:2], "o", color=colour)
            axis.plot([pose[0], pose[0] + np.cos(pose[2])], [pose[1], pose[1] + np.sin(pose[2])], color=colour)
        axis.set_title(f"after update {count}: truth green, best particle red")
        if count == 6:
            break
    figure.savefig(file, dpi=80)


COUNTS = (50, 100, 200, 350, 700, 1400, 3500, 7000, 14000, 28000)

if __name__ == "__main__":
    task, *rest = sys.argv[1:]
    if task == "pictures":
        pictures(*rest)
    else:
        {"success": success, "particles": particles}[task](*map(int, rest))
