"""slam-gdr --landmarks on Bailey's worlds and on recorded logs.

python benchmarks/landmarks.py worlds [seeds]   densemap and webmap, two laps, 20 particles: RMSE without alignment
python benchmarks/landmarks.py real             MR.CLAM 6, robots 1, 3, 5: known map, and SLAM
python benchmarks/landmarks.py speed            time of an observation by particles and landmarks

PFCLI_DATA names the folder with bailey/ and mrclam6/.
"""

import math
import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from pfcli import run
from pfcli.events import Landmarks, Sighting
from pfcli.formats import landmark_csv, landmarklogs
from pfcli.formats.log_writer import LogWriter
from pfcli.registry import system
from pfcli.rng import Draw
from pfcli.simulate import landmarks as simulated
from pfcli.systems.slam_landmarks.params import Params

DATA = Path(os.environ.get("PFCLI_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
SLAM = system("slam-gdr-landmarks")
BAILEY: dict[str, Any] = {
    "motion_xy_per_m": 0.035,
    "motion_xy_m": 0.002,
    "motion_yaw_per_m_rad": 0.005,
    "motion_yaw_rad": 0.001,
}
"""Noise of his controls (0.3 m/s, 3 degrees) over an observation's 0.6 m."""

FILTERS: dict[str, dict[str, Any]] = {
    "FastSLAM 1.0": {"proposal": "fastslam1", "rejuvenate_steps": 0, "resampler": "systematic"},
    "FastSLAM 2.0": {"rejuvenate_steps": 0, "resampler": "systematic"},
    "FastSLAM 2.0, GDR": {"rejuvenate_steps": 0},
    "drawn anew every 25": {},
    "and smoothed": {"smooth": True},
}
CLAM: dict[str, Any] = {
    "range_sigma_m": 0.15,
    "false_share": 0.02,
    "motion_yaw_per_rad": 0.5,
    "particles": 100,
}


def driven(name: str, given: dict[str, Any], seed: int) -> float:
    """RMSE (m) of one drive."""
    world = simulated.read(DATA / "bailey" / f"example_{name}.json")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        simulated.write(world, seed, log)
        params = Params(particles=20, **BAILEY, **given)
        found = run.execute(run.Job(SLAM, params, [log], seed, truth="auto", threads=1))
    truth = {now.stamp_ns: now.truth for now in simulated.play(world, seed) if now.seen is not None}
    track = found.result.track
    off = track.poses[:, :2] - np.array([truth[t][:2] for t in track.stamps_ns.tolist()])
    return float(np.sqrt(np.mean(np.square(off).sum(axis=1))))


def worlds(seeds: int) -> None:
    with ProcessPoolExecutor(2) as pool:
        for name in ("densemap", "webmap"):
            for label, given in FILTERS.items():
                e = np.array(list(pool.map(driven, [name] * seeds, [given] * seeds, range(seeds))))
                low, high = np.quantile(e, (0.25, 0.75))
                print(
                    f"{name}, {label}: median {np.median(e):.2f} m (quartiles {low:.2f}-{high:.2f}), {seeds} seeds",
                    flush=True,
                )


def _mcap(source: Path, folder: Path) -> tuple[Path, Path]:
    """Log and landmark map of a recorded log."""
    found, target = landmarklogs.mrclam(source), folder / f"{source.stem}.mcap"
    with LogWriter(target) as out:
        for event in found.events:
            out.event(event)
    marks = target.with_suffix(".csv")
    landmark_csv.write(marks, found.places)
    return target, marks


def real() -> None:
    with tempfile.TemporaryDirectory() as name:
        for robot in (1, 3, 5):
            log, marks = _mcap(DATA / "mrclam6" / f"Robot{robot}_Measurement.dat.gz", Path(name))
            for label, given in (
                ("known map", {"landmark_map": str(marks)}),
                ("known map, smoothed", {"landmark_map": str(marks), "smooth": True}),
                ("SLAM", {}),
                ("SLAM, smoothed", {"smooth": True}),
            ):
                e = run.execute(run.Job(SLAM, Params(**CLAM, **given), [log], truth="auto", threads=1)).errors
                assert e is not None
                yaw = math.degrees(float(np.sqrt(np.nanmean(e.yaw_rad**2))))
                print(
                    f"robot {robot}, {label}: {np.sqrt(np.nanmean(e.position_m**2)):.3f} m, {yaw:.2f} deg", flush=True
                )


def speed() -> None:
    """Median time of an observation with all landmarks known to all particles."""
    for count in (50, 200, 800):
        world = simulated.SCENARIOS["landmarks-200"]._replace(landmarks=count, duration_s=90.0)
        seen = [now for now in simulated.play(world, 0) if now.seen is not None and now.z is not None]
        for particles in (20, 100):
            params = Params(particles=particles, rejuvenate_steps=0, **BAILEY)
            draw, took, state = Draw(0), [], None
            for now in seen:
                ids, unknown = tuple(str(i) for i in now.seen.tolist()), np.full((now.seen.size, 2), np.nan)
                marks = (Landmarks(now.stamp_ns, ids, now.z[:, 0], now.z[:, 1], unknown),)
                sighting = Sighting(now.stamp_ns, tuple(now.odometry.tolist()), np.empty((0, 2)), marks)
                if state is None:
                    state = SLAM.init(params, SLAM.load(params, None), sighting, draw)
                began = time.perf_counter()
                state, _ = SLAM.step(state, sighting, SLAM.load(params, None), params, draw)
                took.append(1e3 * (time.perf_counter() - began))
            each = np.mean([now.seen.size for now in seen])
            print(
                f"{count} landmarks, {particles} particles, {each:.1f} detections: {np.median(took[50:]):.3f} ms an observation"
            )


if __name__ == "__main__":
    if sys.argv[1] == "worlds":
        worlds(int(sys.argv[2]) if len(sys.argv) > 2 else 50)
    elif sys.argv[1] == "real":
        real()
    else:
        speed()
