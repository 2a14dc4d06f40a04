"""slam-gdr --landmarks on Bailey's worlds, on the paper's, and on recorded logs.

python benchmarks/landmarks.py worlds [seeds]   densemap and webmap, two laps, 20 particles: RMSE without alignment
python benchmarks/landmarks.py bound [seeds]    what least squares on all that was seen so far, and on everything, would give
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
from scipy import sparse
from scipy.optimize import least_squares

from pfcli import run
from pfcli.core import landmark_store
from pfcli.core.geometry import compose
from pfcli.events import Landmarks, Sighting
from pfcli.formats import landmark_csv, landmarklogs
from pfcli.formats.log_writer import LogWriter
from pfcli.registry import system
from pfcli.replay import Settings
from pfcli.report.metrics import align_se2
from pfcli.rng import Draw
from pfcli.simulate import landmarks as simulated
from pfcli.systems.slam_landmarks import history, smooth
from pfcli.systems.slam_landmarks.params import Params

DATA = Path(os.environ.get("PFCLI_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
SLAM = system("slam-gdr-landmarks")
BAILEY: dict[str, Any] = {
    "motion_xy_per_root_m": 0.0274,
    "motion_xy_m": 0.002,
    "motion_yaw_per_root_m": 0.0036,
    "motion_yaw_per_root_rad": 0.02,
    "motion_yaw_rad": 0.0003,
    "motion_across_share": 0.05,
    "motion_pivot_m": 4.0,
}
"""Noise of his controls (0.3 m/s, 3 degrees, each 25 ms), of a car whose pose is its front axle's."""

FILTERS: dict[str, dict[str, Any]] = {
    "FastSLAM 1.0": {"proposal": "fastslam1", "rejuvenate_steps": 0, "resampler": "systematic"},
    "FastSLAM 2.0": {"rejuvenate_steps": 0, "resampler": "systematic"},
    "FastSLAM 2.0, GDR": {"rejuvenate_steps": 0},
    "drawn anew every 25": {},
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
        params = Params(**({"particles": 20} | BAILEY | given))
        found = run.execute(run.Job(SLAM, params, [log], seed, truth="auto", threads=1))
    seen = [now for now in simulated.play(world, seed) if now.seen is not None]
    truth = {now.stamp_ns: now.truth for now in seen}
    track = found.result.track
    off = track.poses[:, :2] - np.array([truth[t][:2] for t in track.stamps_ns.tolist()])
    assert found.errors is not None
    nees = found.errors._replace(offset_m=off).nees(track.columns)
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


def _least_squares(log: smooth.Log, track: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """The track of plain least squares by scipy's solver: nothing of it is pfcli's but the list of measurements."""
    n, known = log.step.shape[0], track[0]

    def residuals(p: np.ndarray) -> np.ndarray:
        poses, places = np.vstack([known, p[: 3 * n].reshape(n, 3)]), p[3 * n :].reshape(-1, 2)
        a, b = poses[:-1], poses[1:]
        c, s, d = np.cos(a[:, 2]), np.sin(a[:, 2]), b[:, :2] - a[:, :2]
        turn = np.remainder(b[:, 2] - a[:, 2] - log.step[:, 2] + np.pi, 2 * np.pi) - np.pi
        e = np.stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0]], axis=1) - log.step[:, :2]
        e[:, 1] -= log.step_sd[:, 3] * turn
        off = places[log.of] - poses[log.at, :2]
        bearing = np.arctan2(off[:, 1], off[:, 0]) - poses[log.at, 2] - log.z[:, 1]
        seen = np.stack([np.hypot(*off.T) - log.z[:, 0], np.remainder(bearing + np.pi, 2 * np.pi) - np.pi], axis=1)
        return np.concatenate([(np.column_stack([e, turn]) / log.step_sd[:, :3]).ravel(), (seen / log.sd).ravel()])

    k, d = np.arange(n), np.arange(log.at.size)
    rows = [
        np.repeat(3 * np.repeat(k, 3) + np.tile(np.arange(3), n), 6),
        np.repeat(3 * n + np.repeat(2 * d, 2) + np.tile([0, 1], d.size), 5),
    ]
    steps = np.repeat(3 * (k[:, None] - 1) + np.arange(6), 3, axis=0)
    seen = np.column_stack([3 * (log.at[:, None] - 1) + np.arange(3), 3 * n + 2 * log.of[:, None] + np.arange(2)])
    row, column = np.concatenate(rows), np.concatenate([steps.ravel(), np.repeat(seen, 2, axis=0).ravel()])
    pattern = sparse.coo_matrix(
        (np.ones(row.size)[column >= 0], (row[column >= 0], column[column >= 0])),
        shape=(3 * n + 2 * d.size, 3 * n + marks.size),
    )
    start = np.concatenate([track[1:].ravel(), marks.ravel()])
    found = least_squares(residuals, start, jac_sparsity=pattern.tocsr(), x_scale="jac", max_nfev=30, tr_solver="lsmr")
    return np.vstack([known, found.x[: 3 * n].reshape(n, 3)])


def bounds(name: str, seed: int) -> tuple[float, float, float]:
    """RMSE of: least squares on all that was seen up to each 50th observation; on everything; on everything by scipy."""
    kept: list[Any] = []

    def finish(state: Any, assets: Any, params: Any) -> Any:
        kept.append(state)
        return SLAM.finish(state, assets, params)

    world = bailey(name)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        simulated.write(world, seed, log)
        params = Params(particles=20, rejuvenate_steps=0, **BAILEY)
        run.execute(run.Job(SLAM._replace(finish=finish), params, [log], seed, threads=1))
    truth = np.array([now.truth for now in simulated.play(world, seed) if now.seen is not None and now.seen.size])
    best = int(np.argmax(kept[0].log_w))
    past = history.of_particle(kept[0].history, best, landmark_store.landmarks(kept[0].store, best))
    whole = smooth.solve(past.log, past.track, past.places)
    reference = _least_squares(past.log, whole.track, whole.marks)
    track, places, errors = whole.track[:1], whole.marks.copy(), []
    for t in range(50, truth.shape[0], 50):
        track, places = _upto(past.log, t, track, places)
        errors.append(np.hypot(*(track[t] - truth[t])[:2]))
    off = [rmse(np.hypot(*(t - truth)[:, :2].T)) for t in (whole.track, reference)]
    return rmse(np.array(errors)), off[0], off[1]


def _upto(log: smooth.Log, t: int, track: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares on what was seen up to observation t, from the solution of an earlier one."""
    rows = list(track)
    for step in log.step[len(rows) - 1 : t]:
        rows.append(compose(rows[-1][None], step[None])[0])
    seen = log.at <= t
    used, of = np.unique(log.of[seen], return_inverse=True)
    part = smooth.Log(log.step[:t], log.step_sd[:t], log.at[seen], of, log.z[seen], log.sd[seen])
    found = smooth.solve(part, np.array(rows), places[used])
    places = places.copy()
    places[used] = found.marks
    return found.track, places


def bound(seeds: int) -> None:
    with ProcessPoolExecutor(2) as pool:
        for name in ("densemap", "webmap"):
            found = np.array(list(pool.map(bounds, [name] * seeds, range(seeds))))
            for k, label in enumerate(
                ("least squares so far", "least squares of everything", "scipy's, of everything")
            ):
                print(f"{name}, {label}: median RMSE {interval(found[:, k])} m, {seeds} seeds", flush=True)


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


def _mcap(source: Path, folder: Path, read: Any = landmarklogs.mrclam) -> tuple[Path, Path]:
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
        log, marks = _mcap(source, Path(name), landmarklogs.stachniss)
        for label, given in (("SLAM", {}), ("SLAM, smoothed", {"smooth": True})):
            _report(f"lectures' world, {label}", log, marks, LECTURES | given, Settings())


def _report(label: str, log: Path, marks: Path, given: dict[str, Any], reading: Settings) -> None:
    truth = None if "lectures" in label else "auto"
    found = run.execute(run.Job(SLAM, Params(**given), [log], settings=reading, truth=truth, threads=1))
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
    rows = []
    for count in (50, 100, 200, 400, 800):
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
    if sys.argv[1] in ("worlds", "bound", "paper"):
        {"worlds": worlds, "bound": bound, "paper": paper}[sys.argv[1]](many)
    elif sys.argv[1] == "real":
        real()
    else:
        speed(sys.argv[2] if len(sys.argv) > 2 else None)
