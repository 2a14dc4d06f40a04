"""localize-partial on recorded logs: Wean Hall log 3 from a global start, Intel and ACES in maps of their first part.

python benchmarks/partial_real.py [seeds]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import partial_map
import worlds

from pfcli.core.evaluation import se2, track_error
from pfcli.core.grid.region import places, region_of
from pfcli.formats import map_yaml, parquet
from pfcli.initial import Initial
from pfcli.params import build
from pfcli.registry import filter_of, system
from pfcli.replay.settings import Settings
from pfcli.runs import loop

WEAN_END = np.array([39.78, 39.81, -0.03])
CUT_S = {"intel": 900.0, "aces": 500.0}


def wean(seeds: int) -> None:
    """End pose of log 3 against the one on which independent filters agree."""
    log = worlds.LOGS / "wean3.mcap"
    if not log.exists():
        worlds.LOGS.mkdir(parents=True, exist_ok=True)
        worlds.pfcli("convert", str(worlds.DATA / "wean/robotdata3.log.gz"), str(log))
    print("| Wean log 3, seed | end off by [m] | [deg] | P(in the map) | loop [s] |\n|---|---|---|---|---|")
    for seed in range(seeds):
        done = partial_map.localise(log, worlds.DATA / "wean/wean.yaml", seed, Initial("inside"))
        off = done.result.track.poses[-1] - WEAN_END
        print(
            f"| {seed} | {np.hypot(*off[:2]):.3f} | {np.degrees(se2.wrap(off[2])):.1f} | {done.infos[-1].in_map:.3f} |"
            f" {done.seconds['loop']:.1f} |",
            flush=True,
        )


def cut(name: str, seeds: int) -> None:
    """The whole log in a map of its first part, against its own full SLAM track. Not independent: map and log share scans."""
    slam = system("slam-gdr")
    log = worlds.recorded(name)
    full = worlds.slam(log, 0)
    first = loop.execute(loop.Job(slam, build(slam.params, {}, "b"), [log], settings=Settings(end_s=CUT_S[name])))
    n = first.result.track.stamps_ns.size
    mine, cut_track = full.result.track.poses[:n], first.result.track.poses
    truth = se2.compose(track_error.align_se2(mine, cut_track)[None], full.result.track.poses)
    residual = np.sqrt(np.mean(np.sum((truth[:n] - cut_track)[:, :2] ** 2, axis=1)))
    grid = first.result.grid
    assert grid is not None
    region = region_of(grid.cells, grid.resolution_m, grid.origin)
    with tempfile.TemporaryDirectory() as folder:
        map_yaml.write(Path(folder), grid)
        for seed in range(seeds):
            done = partial_map.localise(log, Path(folder) / "map.yaml", seed, Initial("unknown"))
            rows = parquet.columns_of(done.infos, filter_of(system("localize-partial")).info)
            stamps, said = np.asarray(rows["t_ns"]), np.asarray(rows["in_map"]) >= 0.5
            index = np.searchsorted(done.result.track.stamps_ns, stamps)
            afterwards = done.result.track.columns["in_map_smoothed"][index] >= 0.5
            there = truth[np.searchsorted(full.result.track.stamps_ns, stamps)]
            inside = places(region, there[:, :2]) != 0
            error = np.hypot(*(done.result.track.poses[index] - there)[:, :2].T)
            ok = inside & said & np.isfinite(error)
            late = stamps > first.result.track.stamps_ns[-1]
            print(
                f"| {name}, {seed} | {(said == inside).mean():.3f}, {(afterwards == inside).mean():.3f} |"
                f" {(said == inside)[late].mean():.3f}, {(afterwards == inside)[late].mean():.3f} |"
                f" {np.median(error[ok]):.3f}, {np.sqrt(np.mean(error[ok] ** 2)):.3f} |"
                f" {inside.mean():.2f} | {residual:.3f} | {done.seconds['loop']:.1f} |",
                flush=True,
            )


def main(seeds: int = 10) -> None:
    """All tables."""
    wean(seeds)
    print(
        "\n| log, seed | in/out right: then, afterwards | the same after the cut | error inside [m]: median, RMSE |"
        " truly inside | residual of the alignment [m] | loop [s] |"
    )
    print("|---|---|---|---|---|---|---|")
    for name in CUT_S:
        cut(name, min(seeds, 4))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
