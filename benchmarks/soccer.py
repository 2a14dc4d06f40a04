"""fuse-soccer in the paper's protocols and beyond them.

python benchmarks/soccer.py routes [seeds]          mean and maximum error as the paper's table 1, with what goes wrong
python benchmarks/soccer.py ablation [seeds]        wheels alone, + compass, + vision, all; each addition switched off
python benchmarks/soccer.py baseline [seeds]        the pose from two landmarks alone
python benchmarks/soccer.py global [trials]         global localisations in 40 ms cycles; histogram as fig. 6
python benchmarks/soccer.py kidnapped [trials]      carried away: cycles until right again
python benchmarks/soccer.py speed                   one update; confidence with and without the table

Converged: the first of three cycles in a row with less than 0.5 m and 15 degrees of error of the estimate and 80 % of
the mass within that. The trials are spread over the cores.
"""

import math
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from pfcli.core.geometry import compose
from pfcli.core.sensor import field_lines
from pfcli.core.threads import set_threads
from pfcli.core.weights import normalize
from pfcli.events import Heading, Sighting
from pfcli.initial import Initial
from pfcli.registry import filter_of, system
from pfcli.replay.settings import Drive
from pfcli.rng import Draw, Purpose, rng_for
from pfcli.runs import loop
from pfcli.simulation import soccer_world
from pfcli.systems.fuse_soccer.field_assets import View
from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.fuse_soccer.sighting_likelihood import of_lines

FUSE = system("fuse-soccer")
DRIVE = Drive(
    "omni",
    soccer_world.JOINTS,
    (soccer_world.WHEEL_RADIUS_M,),
    arm_m=soccer_world.WHEEL_ARM_M,
    angle_deg=(soccer_world.WHEEL_ANGLE_DEG,),
)
CYCLE_NS, MOST = 40_000_000, 60
NEAR_M, NEAR_RAD, MASS = 0.5, math.radians(15.0), 0.8


def replayed(scenario: soccer_world.Soccer, seed: int, params: Params, initial: Initial) -> loop.Run:
    """One simulated log through the whole command."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        soccer_world.write(scenario, seed, log)
        return loop.execute(loop.Job(FUSE, params, [log], seed, drive=DRIVE, truth="auto", threads=1, initial=initial))


def errors(name: str, seed: int, given: dict[str, Any], at_pose: bool) -> tuple[float, float, float]:
    """Mean and maximum error (m) and heading RMSE (deg) of a run."""
    scenario = soccer_world.SCENARIOS[name]
    initial = Initial()
    if at_pose:
        first = next(soccer_world.play(scenario, seed)).truth
        initial = Initial("pose", (float(first[0]), float(first[1]), float(first[2])), (0.1, 0.1, 0.05))
    found = replayed(scenario, seed, Params(**given), initial).errors
    assert found is not None
    return (
        float(np.nanmean(found.position_m)),
        float(np.nanmax(found.position_m)),
        math.degrees(float(np.sqrt(np.nanmean(found.yaw_rad**2)))),
    )


def spread(pool: ProcessPoolExecutor, name: str, seeds: int, given: dict[str, Any], at_pose: bool) -> np.ndarray:
    """(seeds, 3) errors."""
    return np.array(list(pool.map(errors, *zip(*((name, s, given, at_pose) for s in range(seeds)), strict=True))))


def routes(seeds: int) -> None:
    """Every scenario with the defaults, start unknown."""
    with ProcessPoolExecutor(2) as pool:
        for name in soccer_world.SCENARIOS:
            if name != "soccer-kidnap":
                e = spread(pool, name, seeds, {}, False)
                print(
                    f"{name:20s} mean {e[:, 0].mean():.3f} m ({e[:, 0].min():.3f}-{e[:, 0].max():.3f}),"
                    f" maximum median {np.median(e[:, 1]):.3f}, worst {e[:, 1].max():.3f} m, heading {e[:, 2].mean():.2f} deg",
                    flush=True,
                )


WITHOUT: dict[str, dict[str, Any]] = {
    "wheels alone": {"vision": False, "compass": False},
    "wheels + compass": {"vision": False},
    "wheels + vision": {"compass": False},
    "all": {},
    "all, no refinement": {"refine": 0.0},
    "all, noise not adapted": {"adapt": False},
    "all, no bias learnt": {"compass_bias": False},
    "all, never looks about": {"lost_fit": 0.0},
    "all, lines missed count": {"missed": True},
    "all, best particle": {"estimate": "best"},
    "variant paper": {"variant": "paper"},
}


def ablation(seeds: int) -> None:
    """Each part left out, at a known start: on route 1 and where iron bends the compass."""
    with ProcessPoolExecutor(2) as pool:
        for what, given in WITHOUT.items():
            rows = [spread(pool, name, seeds, given, True) for name in ("soccer-route-1", "soccer-bent-compass")]
            text = ", ".join(f"{e[:, 0].mean():.3f} / {e[:, 1].mean():.3f} m {e[:, 2].mean():.2f} deg" for e in rows)
            print(f"{what:24s} {text}", flush=True)


def baseline(seeds: int) -> None:
    """The pose from two detected landmarks beside the filter's, each frame on its own."""
    found, missing = [], 0
    for seed in range(seeds):
        scenario = soccer_world.SCENARIOS["soccer-landmarks"]
        ran = replayed(scenario, seed, Params(), Initial())
        truth = [now.truth for now in soccer_world.play(scenario, seed) if now.points_m is not None]
        two = np.array([(i.two_x_m, i.two_y_m) for i in ran.infos])
        off = np.hypot(*(two - np.array(truth)[-len(two) :, :2]).T)
        missing += int(np.isnan(off).sum())
        found.append(off[np.isfinite(off)])
    off = np.concatenate(found)
    print(
        f"two landmarks: mean {off.mean():.3f} m, median {np.median(off):.3f}, 95 % {np.quantile(off, 0.95):.3f} m;"
        f" {missing} of {missing + off.size} frames have no two"
    )


def cycles(seed: int, trial: int, carried: bool) -> Iterator[tuple[Sighting, np.ndarray]]:
    """A drive from anywhere in any direction, in 40 ms cycles with the noise of eqs (10) and (11); carried: to elsewhere after
    one second."""
    rng = rng_for(seed, Purpose.SIMULATE, trial)
    scenario = soccer_world.SCENARIOS["soccer-route-1"]
    vision = soccer_world.Vision(scenario, rng)
    odometry = np.zeros((1, 3))

    def anywhere() -> tuple[np.ndarray, np.ndarray]:
        pose = np.array([[*rng.uniform((-8.5, -5.5), (8.5, 5.5)), rng.uniform(-math.pi, math.pi)]])
        way = rng.uniform(-math.pi, math.pi)
        shift = scenario.speed_mps * CYCLE_NS * 1e-9
        return pose, np.array([[shift * math.cos(way), shift * math.sin(way), 0.04 * rng.standard_normal()]])

    truth, moved = anywhere()
    for k in range(MOST + 3 + 25 * carried):
        if k == 25 and carried:
            truth, moved = anywhere()
        heading = truth[0, 2] + math.radians(scenario.compass_noise_deg) * rng.standard_normal()
        stamp = 1_000_000_000 + k * CYCLE_NS
        yield (
            Sighting(
                stamp, tuple(odometry[0].tolist()), vision.points(truth[0]), (), Heading(stamp, heading, math.nan)
            ),
            truth[0],
        )
        sd = np.array([0.92, 0.92, 0.48]) * [np.hypot(*moved[0, :2])] * [1, 1, 0] + [0, 0, 0.48 * abs(moved[0, 2])]
        truth = compose(truth, moved)
        if abs(truth[0, 0]) > 8.9 or abs(truth[0, 1]) > 5.9:
            moved[0, :2] *= -1.0
        odometry = compose(odometry, moved + sd * rng.standard_normal(3))


def localised(trials: range, carried: bool) -> list[int]:
    """Cycle at which each trial has converged; 0: never."""
    set_threads(1)
    params = Params()
    assets = filter_of(FUSE).load(params, loop.Job(FUSE, params, []))
    return [_converged(trial, carried, params, assets) for trial in trials]


def _converged(trial: int, carried: bool, params: Params, assets: Any) -> int:
    draw, state, good = Draw(trial), None, 0
    for k, (sighting, truth) in enumerate(cycles(0, trial, carried)):
        if state is None:
            state = filter_of(FUSE).init(params, assets, sighting, draw)
        state, _ = filter_of(FUSE).step(state, sighting, assets, params, draw)
        after = k - 25 if carried else k
        if after < 0:
            continue
        pose = state.belief.pose
        weights, _ = normalize(state.belief.log_w)
        mass = weights[_near(pose, truth)].sum() * (1.0 - state.mirror_p[-1])
        good = good + 1 if _near(state.pose[None], truth)[0] and mass > MASS else 0
        if good == 3:
            return after - 1
    return 0


def _near(poses: np.ndarray, truth: np.ndarray) -> np.ndarray:
    off = np.abs(np.remainder(poses[:, 2] - truth[2] + np.pi, 2 * np.pi) - np.pi)
    return np.asarray((np.hypot(poses[:, 0] - truth[0], poses[:, 1] - truth[1]) < NEAR_M) & (off < NEAR_RAD))


def trials(count: int, carried: bool) -> None:
    """Histogram of the cycles until converged."""
    began = time.perf_counter()
    cuts = [range(k, min(count, k + 100)) for k in range(0, count, 100)]
    with ProcessPoolExecutor(2) as pool:
        found = np.concatenate([np.array(part) for part in pool.map(localised, cuts, [carried] * len(cuts))])
    right = found[found > 0]
    within = f", within 1 s {np.mean((found > 0) & (found <= 25)):.4f}" if carried else ""
    print(
        f"{count} trials in {time.perf_counter() - began:.0f} s: right {right.size / count:.4f}{within};"
        f" cycles median {np.median(right):.0f}, 99 % {np.quantile(right, 0.99):.0f}, worst {right.max()}"
    )
    counts = np.bincount(right, minlength=8)
    print("cycles:", ", ".join(f"{k}: {n}" for k, n in enumerate(counts.tolist()) if n))


def speed() -> None:
    """One update of 500 particles with 100 points; the same evidence by table and without."""
    set_threads(1)
    params = Params()
    assets = filter_of(FUSE).load(params, loop.Job(FUSE, params, []))
    began = time.perf_counter()
    field_lines.build(assets.field.lines)
    print(f"table of the field: {time.perf_counter() - began:.3f} s")
    took: list[float] = []
    for trial in range(20):
        draw, state = Draw(0), None
        for sighting, _ in cycles(0, trial, False):
            if state is None:
                state = filter_of(FUSE).init(params, assets, sighting, draw)
            began = time.perf_counter()
            state, _ = filter_of(FUSE).step(state, sighting, assets, params, draw)
            took.append(1e3 * (time.perf_counter() - began))
    print(f"update, 500 particles, 100 points, one thread: median {np.median(took):.3f} ms")
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(-8, 8, 500), rng.uniform(-5, 5, 500), rng.uniform(-3, 3, 500)])
    points = np.ascontiguousarray(sighting.points_m.T, np.float32)
    sigma = assets.fine.sigma_m[field_lines.range_bins(points)]
    view = View(points=points, sigma_m=sigma, worth=1.0, best=1.0, detections=None, seen=None)
    values, times = [], []
    for given in ({}, {"confidence": "exact"}):
        own = Params(**given)
        of_lines(poses, view, assets, own)
        began = time.perf_counter()
        for _ in range(20):
            found = of_lines(poses, view, assets, own)
        times.append(50.0 * (time.perf_counter() - began))
        values.append(found)
    off = np.abs(values[0] - values[1]) / points.shape[1]
    print(
        f"confidence by table {times[0]:.3f} ms, without {times[1]:.3f} ms: {times[1] / times[0]:.0f} times;"
        f" they differ by {off.mean():.4f} per point on the average, {off.max():.4f} at the most"
    )


if __name__ == "__main__":
    what, number = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 0
    if what == "routes":
        routes(number or 20)
    elif what == "ablation":
        ablation(number or 10)
    elif what == "baseline":
        baseline(number or 5)
    elif what == "global":
        trials(number or 7616, False)
    elif what == "kidnapped":
        trials(number or 1000, True)
    else:
        speed()
