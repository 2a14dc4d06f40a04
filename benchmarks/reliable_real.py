"""localize-reliable on recorded logs: Wean Hall from an unknown start, Intel in its own map.

python benchmarks/reliable_real.py [seeds]

Intel: the map that slam-gdr draws of the whole log, whole and with a third of its walls erased; once more with 60 s cut out of
the log, which is a kidnapping. Map and log share scans: not independent. Truth is the SLAM track.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import worlds
from scipy import ndimage

from pfcli.core.evaluation.se2 import wrap
from pfcli.core.geometry import between, compose
from pfcli.core.grid.grid_map import GridMap
from pfcli.events import Odometry, Pose2
from pfcli.formats import map_yaml
from pfcli.formats.log_writer import LogWriter
from pfcli.initial import Initial
from pfcli.params import build
from pfcli.registry import system
from pfcli.replay.log import Log
from pfcli.runs import loop

SYSTEM = system("localize-reliable")
WEAN_END = np.array([39.78, 39.81, -0.03])
CUT_S, GONE_S = 600.0, 60.0


def localise(log: Path, map_file: Path, seed: int) -> loop.Run:
    """One run from an unknown start."""
    params = build(SYSTEM.params, {}, "b")
    return loop.execute(loop.Job(SYSTEM, params, [log], seed, map=map_file, initial=Initial("inside")))


def wean(number: int, seeds: int) -> None:
    """Ends of a log; log 1 is ambiguous along its corridor: where the seeds agree is all there is to say."""
    log = worlds.LOGS / f"wean{number}.mcap"
    if not log.exists():
        worlds.pfcli("convert", str(worlds.DATA / f"wean/robotdata{number}.log.gz"), str(log))
    print(f"\n| Wean log {number}, seed | end | off by [m], [deg] | p(success) at the end |\n|---|---|---|---|")
    for seed in range(seeds):
        done = localise(log, worlds.DATA / "wean/wean.yaml", seed)
        end = done.result.track.poses[-1]
        off = end - WEAN_END
        known = f"{np.hypot(*off[:2]):.3f}, {np.degrees(wrap(off[2])):.1f}" if number == 3 else ""
        print(f"| {seed} | {np.round(end, 2).tolist()} | {known} | {done.infos[-1].p_success:.3f} |", flush=True)


def without(log: Path, out: Path) -> Path:
    """The log with GONE_S cut out after CUT_S: odometry goes on as if nothing had been."""
    first, before, moved = None, None, None
    with LogWriter(out) as writer:
        for event in Log(log).events(["odometry", "scan"]):
            if first is None:
                writer.tf_static(event.stamp_ns, [("base_link", "laser", Pose2())])
            first = event.stamp_ns if first is None else first
            since = (event.stamp_ns - first) * 1e-9
            if CUT_S <= since < CUT_S + GONE_S:
                continue
            if since >= CUT_S:
                event = event._replace(stamp_ns=event.stamp_ns - round(GONE_S * 1e9))
            if isinstance(event, Odometry):
                here = np.array([event[1:4]])
                if since < CUT_S:
                    before = here
                elif moved is None:
                    moved = (here, before)
                if moved is not None:
                    x, y, yaw = compose(moved[1], between(moved[0], here))[0]
                    event = event._replace(x_m=float(x), y_m=float(y), yaw_rad=float(yaw))
            writer.event(event)
    return out


def erased(grid: GridMap, share: float) -> GridMap:
    """The map without this share of its walls: patches of a metre, their cells made free."""
    rng = np.random.default_rng(0)
    rows, cols = grid.cells.shape
    side = round(1.0 / grid.resolution_m)
    gone = rng.random((-(-rows // side), -(-cols // side))) < share
    patch = np.kron(gone, np.ones((side, side), bool))[:rows, :cols]
    near = ndimage.binary_dilation(grid.cells == 0)
    return grid._replace(cells=np.where(patch & (grid.cells == 1) & near, 0, grid.cells).astype(np.int8))


def intel(seeds: int) -> None:
    """In its own map."""
    log = worlds.recorded("intel")
    full = worlds.slam(log, 0)
    assert full.result.grid is not None
    print(
        "\n| Intel, own map, unknown start | seed | good after 60 s | RMSE when good [m] | p < 0.5 when good |", end=""
    )
    print(" Brier | bound holds | right again after the cut [s] |\n|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        cut = without(log, Path(folder) / "cut.mcap")
        for name, grid in (
            ("whole", full.result.grid),
            ("a third of the walls erased", erased(full.result.grid, 1 / 3)),
        ):
            place = Path(folder) / name.replace(" ", "-")
            place.mkdir()
            map_yaml.write(place, grid)
            for kind, file in (("", log), (", 60 s cut out", cut)):
                for seed in range(seeds):
                    print(
                        f"| {name}{kind} | {seed} | " + _judged(full, file, place / "map.yaml", seed, bool(kind)),
                        flush=True,
                    )


def _judged(full: loop.Run, log: Path, map_file: Path, seed: int, cut: bool) -> str:
    done = localise(log, map_file, seed)
    t = np.array([i.t_ns for i in done.infos])
    pose = done.result.track.poses[np.searchsorted(done.result.track.stamps_ns, t)]
    since = (t - t[0]) * 1e-9
    back = t + np.where(since >= CUT_S, round(GONE_S * 1e9), 0) if cut else t
    track = full.result.track
    true = track.poses[np.minimum(np.searchsorted(track.stamps_ns, back), track.stamps_ns.size - 1)]
    error = np.hypot(*(pose - true)[:, :2].T)
    good = (error <= 0.25) & (np.abs(wrap(pose[:, 2] - true[:, 2])) <= np.radians(5))
    p, bound = np.array([i.p_success for i in done.infos]), np.array([i.protection_m for i in done.infos])
    late = since > 60.0
    after = ""
    if cut:
        lost = np.flatnonzero(since >= CUT_S)
        right = [k for k in lost[:-4] if good[k : k + 5].all()]
        after = f"{since[right[0]] - since[lost[0]]:.1f}" if right else "never"
        late &= ~((since >= CUT_S) & (since < CUT_S + 10.0))
    return (
        f"{good[late].mean():.3f} | {np.sqrt(np.mean(error[late & good] ** 2)):.3f} | {np.mean(p[late & good] < 0.5):.3f} |"
        f" {np.mean((p - good)[late] ** 2):.3f} | {np.mean((error <= bound)[late]):.3f} | {after} |"
    )


def main(seeds: int = 10) -> None:
    """All tables."""
    wean(3, seeds)
    wean(1, seeds)
    intel(min(seeds, 3))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
