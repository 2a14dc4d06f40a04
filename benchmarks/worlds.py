"""Simulated and recorded logs for the benchmarks, kept in a cache folder and made when missing."""

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pfcli.core.evaluation import map_quality, relation_error, se2, spread, track_error
from pfcli.core.jit import cache_root
from pfcli.events import Pose2
from pfcli.formats import carmen, map_yaml, relations
from pfcli.params import build
from pfcli.registry import system
from pfcli.runs import loop

DATA = Path(os.environ.get("PFCLI_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
LOGS = cache_root() / "benchmark-logs"
MAX_DOUBLED = 0.15
MIN_IOU = 0.7
CSAIL_ATE_M = 0.3
"""Consistency as frozen in docs/decisions/005-consistent-map.md."""


def pfcli(*words: str) -> None:
    """Run the command line of this interpreter's pfcli."""
    command = [sys.executable, "-c", "from pfcli.cli.app import run; run()", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):
        sys.exit(f"pfcli {' '.join(words)}: {done.stderr}")


def simulated(scenario: str, seed: int = 0) -> Path:
    """Log of a scenario with its true map beside it."""
    LOGS.mkdir(parents=True, exist_ok=True)
    path = LOGS / f"{scenario}-{seed}.mcap"
    if not path.exists():
        pfcli("simulate", scenario, str(path), "--seed", str(seed), "--true-map")
    return path


def recorded(name: str) -> Path:
    """A recorded CARMEN log as MCAP: intel, aces or csail."""
    LOGS.mkdir(parents=True, exist_ok=True)
    path = LOGS / f"{name}.mcap"
    source = {"intel": "intel/intel.clf.bz2", "aces": "aces/aces.clf.bz2", "csail": "mit-csail/mit-csail.clf.bz2"}[name]
    if not path.exists():
        pfcli("convert", str(DATA / source), str(path))
    return path


def slam(log: Path, seed: int, truth: bool = False, **params: object) -> loop.Run:
    """One run of slam-gdr."""
    slam_gdr = system("slam-gdr")
    job = loop.Job(slam_gdr, build(slam_gdr.params, params, "benchmark"), [log], seed, truth="auto" if truth else None)
    return loop.execute(job)


class Verdict(NamedTuple):
    """Whether a map is consistent, and the numbers that say so."""

    consistent: bool
    iou: float
    doubled: float
    ate_m: float


def judge_simulated(log: Path, done: loop.Run) -> Verdict:
    """Against the true map, aligned by the true track."""
    assert done.result.grid is not None
    assert done.errors is not None
    from pfcli.replay.log import Log

    truth = list(Log(log).events(["truth"]))
    stamps, poses = np.array([e.stamp_ns for e in truth]), np.array([e[1:4] for e in truth])
    track = done.result.track
    there = track_error.interpolate(track.stamps_ns, stamps, poses)
    known = np.isfinite(there[:, 0])
    moved = Pose2(*track_error.align_se2(track.poses[known], there[known]).tolist())
    true_map = map_yaml.read(log.with_suffix(".yaml"))
    iou = map_quality.map_iou(done.result.grid, true_map, moved).iou
    doubled = map_quality.doubled_walls(done.result.grid) - map_quality.doubled_walls(true_map)
    return Verdict(iou >= MIN_IOU and doubled <= MAX_DOUBLED, iou, doubled, done.errors.summary()["ate_m"])


def csail_reference() -> dict[str, tuple[float, float, float]]:
    """Poses of the GMapping log by stamp text (agreement, not truth)."""
    records, _ = carmen.read(DATA / "mit-csail/csail-corrected.log.gz")
    # in a corrected log the robot pose is the corrected one
    return {r.stamp: r.odometry for r in records if r.ranges_m is not None}


def csail_ate(done: loop.Run) -> float:
    """ATE against the GMapping log after SE(2) alignment (m)."""
    reference = csail_reference()
    index = {text: k for k, text in enumerate(done.result.track.columns["source_stamp"])}
    keys = [k for k in reference if k in index]
    return ate(done.result.track.poses[[index[k] for k in keys]], np.array([reference[k] for k in keys]))


def csail_doubled(done: loop.Run) -> tuple[float, float]:
    """Doubled-wall scores of two maps drawn alike from the same scans: at our poses, and at those of the GMapping log.

    The scans are those at which both have a pose of their own (an update, not odometry in between).
    """
    from pfcli.core.grid import tiles
    from pfcli.core.grid.scan_points import beams_of, points_of
    from pfcli.systems.shared.tile_map import grid_of

    track = done.result.track
    updates = track.columns["update"]
    mine = {t: p for t, p, u in zip(track.columns["source_stamp"], track.poses, updates, strict=True) if u}
    records, _ = carmen.read(DATA / "mit-csail/csail-corrected.log.gz")
    shared = [r for r in records if r.stamp in mine]
    scores = []
    for poses in (mine, csail_reference()):
        maps = tiles.empty(1, 0.05)
        for r in shared:
            assert r.ranges_m is not None
            points = points_of(r.ranges_m, r.angles, (0.0, 81.0), r.mount, 1, 0.0, 0.05)
            maps = tiles.draw(maps, np.array([poses[r.stamp]]), np.ones(1, bool), beams_of(points, r.mount))
        scores.append(map_quality.doubled_walls(grid_of(maps, 0)))
    return scores[0], scores[1]


def csail_other() -> dict[int, tuple[float, float, float]]:
    """Poses by scan number of the other GMapping track of the recording (agreement, not truth)."""
    import gzip

    with gzip.open(DATA / "mit-csail/reference.csv.gz", "rt") as file:
        rows = [line.split(",") for line in file if line[0].isdigit()]
    return {int(r[0]): (float(r[2]), float(r[3]), float(r[4])) for r in rows if int(r[5])}


def ate(mine: np.ndarray, theirs: np.ndarray) -> float:
    """RMSE of the positions after SE(2) alignment (m)."""
    moved = se2.compose(track_error.align_se2(mine, theirs)[None], mine)
    return float(np.sqrt(((moved - theirs)[:, :2] ** 2).sum(axis=1).mean()))


def csail_ate_other(done: loop.Run) -> float:
    """ATE against the other track."""
    other = {k: p for k, p in csail_other().items() if k < len(done.result.track.poses)}
    return ate(done.result.track.poses[list(other)], np.array(list(other.values())))


def relation_spread(name: str, done: loop.Run) -> dict[str, spread.Spread]:
    """Relations of intel or aces: all, and those >= 100 scans apart."""
    track = done.result.track
    errors = relation_error.relation_errors(
        relations.read(DATA / name / f"{name}.relations"), track.columns["source_stamp"], track.poses
    )
    far = errors.scans_apart >= relation_error.FAR_SCANS
    return {
        "all": spread.spread(errors.translation_m),
        "rotation": spread.spread(np.degrees(errors.rotation_rad)),
        "far": spread.spread(errors.translation_m[far]),
    }


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    z, p = 1.96, successes / trials
    centre, half = p + z * z / (2 * trials), z * np.sqrt(p * (1 - p) / trials + z * z / (4 * trials**2))
    return float((centre - half) / (1 + z * z / trials)), float((centre + half) / (1 + z * z / trials))
