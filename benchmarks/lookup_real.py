"""localize-lookup on recorded logs from an unknown start: tinySLAM and LEGO in maps by slam-gdr from encoders, Wean Hall.

python benchmarks/lookup_real.py [seeds]

Converged: the first update of which `first_certain_s` speaks (80 % of the mass in one hypothesis of 0.3 m). LEGO's
reference is an external camera's position of the laser; the map is laid over it once, by the track that made the map.
Its scanner's metre is not the camera's: with the camera's positions, scans overlap best when ranges are taken times 1.12
(smallest entropy of the end points, steps of 0.03), and so do the wheels by 1.07.
"""

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import worlds

from pfcli.core.evaluation import se2, track_error
from pfcli.core.geometry import compose
from pfcli.formats import map_yaml
from pfcli.initial import Initial
from pfcli.params import build
from pfcli.registry import system
from pfcli.replay.settings import Drive
from pfcli.runs import loop

WEAN_END = np.array([39.78, 39.81, -0.03])
DRIVES = {
    "tinyslam exp1": ("tinyslam/exp1.dat.gz", (0.077, 0.33), 0.145, {}, {}),
    "tinyslam test_lab": ("tinyslam/test_lab.dat.gz", (0.077, 0.33), 0.145, {}, {}),
    "lego": (
        "lego",
        (0.0213, 0.173),
        0.03,
        {"resolution_m": 0.01, "update_distance_m": 0.05},
        {
            "table_range_m": 4.0,
            "sigma_hit_m": 0.03,
            "reach_m": 2.0,
            "update_distance_m": 0.03,
            "start_density_per_m2": 2000.0,
        },
    ),
}


def converted(source: str) -> Path:
    worlds.LOGS.mkdir(parents=True, exist_ok=True)
    path = worlds.LOGS / (source.replace("/", "-").removesuffix(".gz") + ".mcap")
    if not path.exists():
        scale = "1.12" if source == "lego" else "1"
        worlds.pfcli("convert", str(worlds.DATA / source), str(path), "--range-scale", scale)
    return path


def job(
    name: str, log: Path, params: dict[str, Any], seed: int, wheels: tuple[float, float] | None, **more: Any
) -> loop.Run:
    found = system(name)
    drive = Drive(radius_m=(wheels[0],), track_m=wheels[1]) if wheels else Drive()
    return loop.execute(loop.Job(found, build(found.params, params, "b"), [log], seed, drive=drive, **more))


def laser(poses: np.ndarray, ahead_m: float) -> np.ndarray:
    return compose(np.ascontiguousarray(poses), np.array([[ahead_m, 0.0, 0.0]]))


def reference() -> tuple[np.ndarray, np.ndarray]:
    """Stamps (ns) and positions (m) of LEGO's laser."""
    rows = [line.split() for line in open(worlds.DATA / "lego/robot4_reference.txt") if line.startswith("P")]
    return np.array([int(r[1]) * 1_000_000 for r in rows]), np.array([[float(r[2]), float(r[3])] for r in rows]) * 1e-3


def main(seeds: int = 10) -> None:
    print("| log | seed | certain since [s] | error after that [m]: mean, max | looks around | ms/update |")
    print("|---|---|---|---|---|---|")
    for name, (source, wheels, ahead, mapping, params) in DRIVES.items():
        log = converted(source)
        slam = job("slam-gdr", log, mapping, 0, wheels)
        with tempfile.TemporaryDirectory() as folder:
            map_yaml.write(Path(folder), slam.result.grid)
            for seed in range(seeds):
                place = {"map": Path(folder) / "map.yaml", "initial": Initial("inside")}
                done = job("localize-lookup", log, params, seed, wheels, **place)
                report(name, seed, done, slam, ahead)
    wean(seeds)


def report(name: str, seed: int, done: loop.Run, slam: loop.Run, ahead: float) -> None:
    mine, track = laser(done.result.track.poses, ahead), laser(slam.result.track.poses, ahead)
    stamps = done.result.track.stamps_ns
    if name == "lego":
        when, where = reference()
        there = np.column_stack([np.interp(stamps, when, where[:, k]) for k in (0, 1)] + [np.zeros(stamps.size)])
        seen = (stamps >= when[0]) & (stamps <= when[-1])
        mine = compose(track_error.align_se2(track[seen], there[seen])[None], mine)
    else:
        there, seen = track, np.ones(stamps.size, bool)
    since = done.result.summary["first_certain_s"]
    after = seen & (stamps >= stamps[0] + (since if since is not None else np.inf) * 1e9)
    error = np.hypot(*(mine - there)[after, :2].T)
    told = f"{error.mean():.4f}, {error.max():.3f}" if error.size else "never"
    ms = 1e3 * done.seconds["loop"] / len(done.infos)
    print(f"| {name} | {seed} | {since} | {told} | {done.result.summary['looks_around']} | {ms:.2f} |", flush=True)


def wean(seeds: int) -> None:
    log = worlds.LOGS / "wean3.mcap"
    if not log.exists():
        worlds.pfcli("convert", str(worlds.DATA / "wean/robotdata3.log.gz"), str(log))
    print("\n| Wean log 3, seed | end off by [m] | [deg] | looks around |\n|---|---|---|---|")
    for seed in range(seeds):
        done = job(
            "localize-lookup", log, {}, seed, None, map=worlds.DATA / "wean/wean.yaml", initial=Initial("inside")
        )
        off = done.result.track.poses[-1] - WEAN_END
        looks = done.result.summary["looks_around"]
        print(f"| {seed} | {np.hypot(*off[:2]):.3f} | {np.degrees(se2.wrap(off[2])):.1f} | {looks} |", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
