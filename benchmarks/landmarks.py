"""slam-gdr --landmarks on Bailey's worlds, on the paper's, and on recorded logs.

python benchmarks/landmarks.py worlds [seeds]   densemap and webmap, two laps, 20 particles: RMSE without alignment
python benchmarks/landmarks.py paper [seeds]    figs 3-5, table 1: GDR against systematic resampling, paired, both worlds
python benchmarks/landmarks.py real             MR.CLAM 6, robots 1, 3, 5, and the lectures' world
python benchmarks/landmarks.py speed [PICTURE]  time of an observation by particles and landmarks

PFCLI_DATA names the folder with bailey/, mrclam6/ and stachniss/.
"""

import math
import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pfcli.core.evaluation.track_error import align_se2
from pfcli.core.geometry import compose
from pfcli.events import Landmarks, Sighting, Steering
from pfcli.formats import landmark_csv, landmark_logs
from pfcli.formats.log_writer import LogWriter
from pfcli.registry import filter_of, system
from pfcli.replay.dead_reckoning import DeadReckoning
from pfcli.replay.settings import Drive, Settings
from pfcli.rng import Draw
from pfcli.runs import loop
from pfcli.simulation import landmark_world as simulated
from pfcli.systems.slam_landmarks.params import Params

DATA = Path(os.environ.get("PFCLI_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
SLAM = system("slam-gdr-landmarks")
FILTERS: dict[str, dict[str, Any]] = {
    "FastSLAM 1.0": {"proposal": "fastslam1", "rejuvenate_steps": 0, "resampler": "systematic"},
    "FastSLAM 2.0": {"rejuvenate_steps": 0, "resampler": "systematic"},
    "FastSLAM 2.0, GDR": {"rejuvenate_steps": 0},
    "drawn anew every 10": {},
    "FastSLAM 2.0, GDR, smoothed": {"rejuvenate_steps": 0, "smooth": True},
}
CLAM: dict[str, Any] = {
    "range_sigma_m": 0.02,
    "range_sigma_share": 0.02,
    "bearing_sigma_deg": 0.7,
    "false_share": 0.02,
    "particles": 100,
}
AS_WRITTEN = CLAM | {"range_sigma_m": 0.15, "range_sigma_share": 0.0, "bearing_sigma_deg": 1.0}
LECTURES: dict[str, Any] = {"range_sigma_m": 0.3, "bearing_sigma_deg": 6.0, "landmark_range_m": 50.0}
READING = Settings(landmark_ranges="depth", offsets_s={"twist": 0.2})
"""Their ranges are depths; what they were told to drive they do 0.2 s later."""


class Driven(NamedTuple):
    """One drive: errors of the positions (m) of all observations, seconds of the loop, landmarks, those that were ever in range,
    resamplings, and the mean of the normalised squared errors."""

    error_m: np.ndarray
    loop_s: float
    landmarks: int
    in_range: int
    resamplings: int
    nees: float


def driven(world: simulated.LandmarkWorld, given: dict[str, Any], seed: int) -> Driven:
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        simulated.write(world, seed, log)
        params = Params(**({"particles": 20} | simulated.NOISE | given))
        found = loop.execute(loop.Job(SLAM, params, [log], seed, truth="auto", threads=1))
    seen = [now for now in simulated.play(world, seed) if now.seen is not None]
    truth = {now.stamp_ns: now.truth for now in seen}
    track = found.result.track
    off = track.poses[:, :2] - np.array([truth[t][:2] for t in track.stamps_ns.tolist()])
    assert found.errors is not None
    nees = found.errors._replace(offset_m=off).normalised(track.columns)
    assert nees is not None
    return Driven(
        np.hypot(*off.T),
        found.seconds["loop"],
        found.result.summary["landmarks"],
        len({int(i) for now in seen for i in now.seen.tolist()}),
        found.result.summary["resamplings"],
        float(np.nanmean(nees)),
    )


def bailey(name: str) -> simulated.LandmarkWorld:
    return simulated.read(DATA / "bailey" / f"example_{name}.json")


def rmse(error_m: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error_m**2)))


def interval(values: np.ndarray) -> str:
    """Median with the 95 % interval of the bootstrap over seeds."""
    rng = np.random.default_rng(0)
    low, high = np.quantile(np.median(rng.choice(values, (2000, values.size)), axis=1), (0.025, 0.975))
    return f"{np.median(values):.3g} ({low:.3g}-{high:.3g})"


def worlds(seeds: int) -> None:
    with ProcessPoolExecutor(2) as pool:
        for name in ("densemap", "webmap"):
            for label, given in FILTERS.items():
                ran = list(pool.map(driven, [bailey(name)] * seeds, [given] * seeds, range(seeds)))
                e, nees = np.array([rmse(r.error_m) for r in ran]), np.array([r.nees for r in ran])
                low, high = np.quantile(e, (0.25, 0.75))
                print(
                    f"{name}, {label}: median RMSE {interval(e)} m, quartiles {low:.2f}-{high:.2f},"
                    f" NEES {np.median(nees):.2f}, {seeds} seeds",
                    flush=True,
                )


def paper(seeds: int) -> None:
    """The printed experiments: FastSLAM 2.0 as it is, the two resamplers on the same drives."""
    plain = {"rejuvenate_steps": 0}
    kinds = {"GDR": {}, "systematic": {"resampler": "systematic"}}
    with ProcessPoolExecutor(2) as pool:
        for name in ("landmarks-50", "landmarks-200"):
            world = simulated.SCENARIOS[name]
            for particles in (5, 20, 100):
                both = {}
                for label, given in kinds.items():
                    options = plain | given | {"particles": particles}
                    both[label] = list(pool.map(driven, [world] * seeds, [options] * seeds, range(seeds)))
                for label, ran in both.items():
                    e, minute = (np.array([rmse(r.error_m[:last]) for r in ran]) for last in (None, 300))
                    missed = sum(r.in_range - r.landmarks for r in ran)
                    again = np.array([float(r.resamplings) for r in ran])
                    ms = np.median([1e3 * r.loop_s / r.error_m.size for r in ran])
                    print(
                        f"{name}, N = {particles}, {label}: RMSE {interval(e)} m, first minute {interval(minute)} m, resamplings"
                        f" {interval(again)}, landmarks missed {missed} of {sum(r.in_range for r in ran)}, {ms:.3f} ms",
                        flush=True,
                    )
                ratio = [
                    rmse(a.error_m) / rmse(b.error_m) for a, b in zip(both["GDR"], both["systematic"], strict=True)
                ]
                print(
                    f"{name}, N = {particles}, RMSE of GDR by systematic, paired: {interval(np.array(ratio))}",
                    flush=True,
                )


def _mcap(source: Path, folder: Path, read: Any = landmark_logs.mrclam) -> tuple[Path, Path]:
    """Log and landmark map of a recorded log."""
    found, target = read(source), folder / f"{source.stem}.mcap"
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
            known = {"landmark_map": str(marks)}
            _report(f"robot {robot}, ranges as distances", log, marks, AS_WRITTEN | known, Settings())
            for label, given in (
                ("known map", known),
                ("known map, smoothed", known | {"smooth": True}),
                ("known map, calibrated", known | {"calibrate": True}),
                ("known map, calibrated, smoothed", known | {"calibrate": True, "smooth": True}),
                ("SLAM", {}),
                ("SLAM, smoothed", {"smooth": True}),
                ("SLAM, ids unknown", {"association": "unknown"}),
            ):
                _report(f"robot {robot}, {label}", log, marks, CLAM | given, READING)
        source = DATA / "stachniss" / "sensor_data.dat"
        log, marks = _mcap(source, Path(name), landmark_logs.stachniss)
        for label, given in (("SLAM", {}), ("SLAM, smoothed", {"smooth": True})):
            _report(f"lectures' world, {label}", log, marks, LECTURES | given, Settings())


def _report(label: str, log: Path, marks: Path, given: dict[str, Any], reading: Settings) -> None:
    truth = None if "lectures" in label else "auto"
    found = loop.execute(loop.Job(SLAM, Params(**given), [log], settings=reading, truth=truth, threads=1))
    words = [label]
    if found.errors is not None:
        yaw = math.degrees(float(np.sqrt(np.nanmean(found.errors.yaw_rad**2))))
        words.append(f"{np.sqrt(np.nanmean(found.errors.position_m**2)):.3f} m, {yaw:.2f} deg")
    if not given.get("landmark_map") and given.get("association") != "unknown":
        table, places = found.result.tables["landmarks"], landmark_csv.read(marks)
        there = np.array([places[i] for i in table["id"]])
        here = np.column_stack([table["x_m"], table["y_m"]])
        by = align_se2(here, there)
        off = compose(by[None], np.column_stack([here, np.zeros(len(here))]))[:, :2] - there
        words.append(f"{len(here)} of {len(places)} landmarks, RMSE {rmse(np.hypot(*off.T)):.3f} m aligned")
    else:
        words.append(f"{found.result.summary['landmarks']} landmarks")
    words += [f"{k} {v}" for k, v in found.result.summary.items() if "scale" in k]
    print(", ".join(words), flush=True)


def speed(picture: str | None) -> None:
    """Median time of an observation with all landmarks known to all particles."""
    reckon, began = DeadReckoning("twist", Drive(axles_m=4.0)), time.perf_counter()
    for k in range(80_000):
        reckon(Steering(k * 25_000_000, 3.0, 0.1))
    controls_ms = 8 * 1e3 * (time.perf_counter() - began) / 80_000
    print(f"8 controls of an observation: {controls_ms:.3f} ms")
    rows = []
    for count in (50, 100, 200, 400, 800):
        world = simulated.SCENARIOS["landmarks-200"]._replace(landmarks=count, duration_s=90.0)
        seen = [now for now in simulated.play(world, 0) if now.seen is not None and now.z is not None]
        for particles in (20, 100):
            params = Params(particles=particles, rejuvenate_steps=0, **simulated.NOISE)
            draw, took, state = Draw(0), [], None
            assets = filter_of(SLAM).load(params, loop.Job(SLAM, params, []))
            for now in seen:
                ids, unknown = tuple(str(i) for i in now.seen.tolist()), np.full((now.seen.size, 2), np.nan)
                marks = (Landmarks(now.stamp_ns, ids, now.z[:, 0], now.z[:, 1], unknown),)
                sighting = Sighting(now.stamp_ns, tuple(now.odometry.tolist()), np.empty((0, 2)), marks)
                if state is None:
                    state = filter_of(SLAM).init(params, assets, sighting, draw)
                began = time.perf_counter()
                state, _ = filter_of(SLAM).step(state, sighting, assets, params, draw)
                took.append(1e3 * (time.perf_counter() - began))
            each = np.mean([now.seen.size for now in seen])
            rows.append((particles, count, float(np.median(took[50:]))))
            print(
                f"{count} landmarks, {particles} particles, {each:.1f} detections: {np.median(took[50:]):.3f} ms an observation"
            )
    if picture:
        _growth(rows, Path(picture))


def _growth(rows: list[tuple[int, int, float]], path: Path) -> None:
    """Time of an observation over the number of landmarks."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    for particles in sorted({row[0] for row in rows}):
        own = [(count, ms) for n, count, ms in rows if n == particles]
        axes.loglog(*zip(*own, strict=True), "o-", label=f"{particles} particles")
    axes.set(xlabel="landmarks", ylabel="ms an observation")
    axes.legend()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    many = int(sys.argv[2]) if len(sys.argv) > 2 and sys.argv[2].isdigit() else 50
    if sys.argv[1] in ("worlds", "paper"):
        {"worlds": worlds, "paper": paper}[sys.argv[1]](many)
    elif sys.argv[1] == "real":
        real()
    else:
        speed(sys.argv[2] if len(sys.argv) > 2 else None)
