"""fuse-soccer on what is public of real robots: frames of lines, and wheels against OptiTrack.

python benchmarks/soccer_real.py frames          global pose from one frame, with and without heading
python benchmarks/soccer_real.py wheels          dead reckoning before and after calibration, tested on other logs
python benchmarks/soccer_real.py match [seeds]   the true motions on the field, line points with the real frame's residuals

PFCLI_DATA names the folder with soccer-lines/, polimi-mecanum/ and optiodom/.
"""

import math
import os
import sys
import tempfile
from pathlib import Path

import numpy as np

from pfcli.cli.commands.calibrate_omni import rolled_of_log
from pfcli.core.geometry import between, compose
from pfcli.dropped import Dropped
from pfcli.events import Heading, LinePoints, Sighting, Ticks, Truth
from pfcli.formats import conversion, line_frames, tick_logs
from pfcli.formats.limits import AS_IT_IS
from pfcli.formats.log_writer import LogWriter
from pfcli.registry import filter_of, system
from pfcli.replay.log import Log
from pfcli.replay.settings import Drive, Settings
from pfcli.rng import Draw, Purpose, rng_for
from pfcli.runs import loop
from pfcli.simulation import soccer_world
from pfcli.systems.fuse_soccer import base_calibration, start_on_field
from pfcli.systems.fuse_soccer.field_assets import view_of
from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.fuse_soccer.sighting_likelihood import of_lines, turned

DATA = Path(os.environ.get("PFCLI_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
FUSE = system("fuse-soccer")
LAB = """length: 8.9
width: 5.58
line_width: 0.1223
centre_circle: 1.0
penalty_area: [3.6, 1.29]
goal_area: [2.8, 0.4]
corner_arc: 0.35
penalty_spot: 2.0
goal_width: 2.0
"""
"""The training field of two of the Carpe Noctem frames, from their FootballField.conf."""


def frames() -> None:
    """The pose of one frame against what its team's solver found; which side is which cannot be seen without a heading."""
    with tempfile.TemporaryDirectory() as folder:
        lab = Path(folder) / "lab.yaml"
        lab.write_text(LAB)
        falcons = next((DATA / "soccer-lines/falcons_r5").glob("test3*.json"))
        frame = line_frames.falcons(falcons)
        known = next(np.array(e[1:4]) for e in frame.events if isinstance(e, Truth))
        _frame("Falcons", "msl-18x12", frame, known)
        for name, field in (("myo", "msl-18x12"), ("foxy", str(lab)), ("mops", str(lab))):
            place = DATA / "soccer-lines/carpe_noctem" / name
            frame = line_frames.carpe_noctem(place / "LinePoints.txt")
            # their field as the robot saw it: its own pose, found on 900 points without noise
            matched = np.loadtxt(place / "MatchedLined0.txt") * 1e-3
            known = _best(field, Sighting(0, (0.0, 0.0, 0.0), matched, ()), 100.0)
            _frame(name, field, frame, known)


def _best(field: str, sighting: Sighting, range_m: float = 9.0) -> np.ndarray:
    params = Params(field=field, max_range_m=range_m, points=1000)
    assets = filter_of(FUSE).load(params, loop.Job(FUSE, params, []))
    found = start_on_field.peaks(view_of(sighting, assets, params), None, assets, params, np.random.default_rng(0))
    return np.asarray(found.mean[int(np.argmax(found.weight))])


def _fit(field: str, points: np.ndarray, pose: np.ndarray) -> float:
    """Evidence of a frame at a pose as a share of the best that its points could have."""
    params = Params(field=field, max_range_m=9.0)
    assets = filter_of(FUSE).load(params, loop.Job(FUSE, params, []))
    view = view_of(Sighting(0, (0.0, 0.0, 0.0), points, ()), assets, params)
    return float(of_lines(pose[None], view, assets, params)[0] / view.best)


def _frame(name: str, field: str, frame: line_frames.Frame, known: np.ndarray) -> None:
    points = next(e.points_m for e in frame.events if isinstance(e, LinePoints))
    heading = next((e for e in frame.events if isinstance(e, Heading)), None)
    share = [_fit(field, points, pose) for pose in (known, _best(field, Sighting(0, (0.0, 0.0, 0.0), points, ())))]
    print(
        f"{name}: at the known pose the points have {share[0]:.2f} of the best evidence that they could have,"
        f" at the best pose {share[1]:.2f} (simulated right poses: 0.4-0.7)"
    )
    for compass in (heading, None) if heading is not None else (None,):
        found = []
        for seed in range(10):
            params = Params(field=field, max_range_m=9.0)
            assets = filter_of(FUSE).load(params, loop.Job(FUSE, params, []))
            sighting, draw = Sighting(1, (0.0, 0.0, 0.0), points, (), compass), Draw(seed)
            state, _ = filter_of(FUSE).step(
                filter_of(FUSE).init(params, assets, sighting, draw), sighting, assets, params, draw
            )
            found.append((state.pose, state.mirror_p[-1]))
        off = [_off(pose, known) for pose, _ in found]
        either = [min(_off(pose, known), _off(turned(pose[None])[0], known)) for pose, _ in found]
        print(
            f"{name}: {points.shape[0]} points, {'with heading' if compass else 'without'}: known {np.round(known, 2)},"
            f" found {np.round(found[0][0], 2)}, p of the other side {found[0][1]:.3f};"
            f" off by {np.median(off):.2f} m, it or its mirror image {np.median(either):.2f} m (worst {max(either):.2f})"
        )


def _off(pose: np.ndarray, known: np.ndarray) -> float:
    return float(np.hypot(*(pose - known)[:2]))


POLIMI = Drive("mecanum", None, (0.07,), track_m=0.338, axles_m=0.4, ticks_per_turn=42 * 5)
OMNI3 = Drive("omni", ("wheel_1", "wheel_2", "wheel_3"), (0.051,), arm_m=0.195, angle_deg=(-60.0, 60.0, 180.0))
OMNI4 = Drive("mecanum", None, (0.03,), track_m=0.215, axles_m=0.205)


def wheels() -> None:
    """Calibrated on one part, tested on others."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bag = folder / "polimi.mcap"
        conversion.convert([DATA / "polimi-mecanum/bag1.bag"], bag, "zstd", AS_IT_IS)
        topics = {"truth": "/robot/pose"}
        halves = [
            rolled_of_log(Log(bag, Settings(topics=topics, end_s=29.4)), POLIMI, Dropped()),
            rolled_of_log(Log(bag, Settings(topics=topics, start_s=29.4)), POLIMI, Dropped()),
        ]
        tested = []
        for k in (0, 1):
            fit = base_calibration.fit_wheels([halves[k]], POLIMI)
            tested.append(_tell(f"PoliMi, half {k + 1}", fit, POLIMI, [halves[1 - k]])[0])
        print(f"PoliMi, mean of both ways: {np.mean(tested):.3f} m")
        for kind, drive in (("omni3", OMNI3), ("omni4", OMNI4)):
            runs = [
                rolled_of_log(_mcap(path, folder), drive, Dropped())
                for path in sorted((DATA / "optiodom" / kind).glob("*_run-*.csv"))
            ]
            fit = base_calibration.fit_wheels(runs[:1], drive)
            _tell(f"{kind}, run 1", fit, drive, runs[1:])


def _mcap(source: Path, folder: Path) -> Log:
    """A log of ticks and truth."""
    target = folder / f"{source.stem}.mcap"
    with LogWriter(target) as out:
        for event in tick_logs.optiodom(source).events:
            out.event(event)
    return Log(target)


def _tell(name: str, fit: base_calibration.Fit, nominal: Drive, tests: list[base_calibration.Rolled]) -> list[float]:
    before = base_calibration.Fit(nominal, (0.0, 0.0, 0.0))
    errors = [(base_calibration.error_m(t, before)[0], base_calibration.error_m(t, fit)[0]) for t in tests]
    ratio = np.array(fit.drive.radius_m) / np.broadcast_to(np.array(nominal.radius_m), len(fit.drive.radius_m))
    print(
        f"{name}: tested on {len(tests)}: {', '.join(f'{b:.3f} -> {a:.3f} m' for b, a in errors)};"
        f" radii {np.round(fit.drive.radius_m, 4)} ({np.round(ratio, 3)} of nominal), mount {np.round(fit.mount, 3)}"
    )
    return [after for _, after in errors]


RANGE_RMS = ((0.0, 0.087), (2.0, 0.087), (3.0, 0.054), (5.0, 0.114), (6.5, 0.2))
"""Residuals of the Falcons frame by range (data/README.md)."""


def match(seeds: int) -> None:
    """The recorded encoders and true motions, on the field; points of lines with the residuals of the real frame."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bag = folder / "polimi.mcap"
        conversion.convert([DATA / "polimi-mecanum/bag1.bag"], bag, "zstd", AS_IT_IS)
        logs = [("PoliMi", Log(bag, Settings(topics={"truth": "/robot/pose"})), POLIMI)]
        for kind, drive in (("omni3", OMNI3), ("omni4", OMNI4)):
            logs.append((kind, _mcap(sorted((DATA / "optiodom" / kind).glob("*_run-*.csv"))[0], folder), drive))
        for what, log, drive in logs:
            errors = np.array([_played(log, drive, seed, folder) for seed in range(seeds)])
            print(
                f"{what}: mean {errors[:, 0].mean():.3f} m ({errors[:, 0].min():.3f}-{errors[:, 0].max():.3f}),"
                f" maximum median {np.median(errors[:, 1]):.3f}, worst {errors[:, 1].max():.3f} m,"
                f" heading {errors[:, 2].mean():.2f} deg; {seeds} seeds"
            )


def _played(log: Log, drive: Drive, seed: int, folder: Path) -> tuple[float, float, float]:
    """One drive from another place on the field, ten frames a second."""
    rng = rng_for(seed, Purpose.SIMULATE, 0)
    vision = soccer_world.Vision(
        soccer_world.SCENARIOS["soccer-route-1"]._replace(false_share=0.1, point_noise=0.0), rng
    )
    place = np.array([[*rng.uniform((-5.0, -3.0), (5.0, 3.0)), rng.uniform(-math.pi, math.pi)]])
    start_pose, due, target = None, 0, folder / "match.mcap"
    at, sigma = zip(*RANGE_RMS, strict=True)
    with LogWriter(target) as out:
        for event in log.events(["encoders", "truth"]):
            if not isinstance(event, Truth):
                if isinstance(event, Ticks):
                    out.ticks(event)
                else:
                    turn = event.position_rad.astype(np.int64)
                    out.ticks(Ticks(event.stamp_ns, event.names, turn, drive.ticks_per_turn, True))
                continue
            pose = np.array([event[1:4]])
            start_pose = pose if start_pose is None else start_pose
            truth = compose(place, between(start_pose, pose))[0]
            out.pose(event.stamp_ns, tuple(truth))
            if event.stamp_ns < due:
                continue
            due = event.stamp_ns + 100_000_000
            points = vision.points(truth)
            spread = np.interp(np.hypot(points[:, 0], points[:, 1]), at, sigma)
            noisy = points + spread[:, None] * rng.standard_normal(points.shape)
            out.line_points(LinePoints(event.stamp_ns, noisy))
            out.heading(Heading(event.stamp_ns, truth[2] + math.radians(5.0) * rng.standard_normal(), math.nan))
    job = loop.Job(FUSE, Params(), [target], seed, drive=drive._replace(ticks_per_turn=0.0), truth="auto", threads=1)
    errors = loop.execute(job).errors
    assert errors is not None
    rms = math.degrees(float(np.sqrt(np.nanmean(errors.yaw_rad**2))))
    return float(np.nanmean(errors.position_m)), float(np.nanmax(errors.position_m)), rms


if __name__ == "__main__":
    if sys.argv[1] == "frames":
        frames()
    elif sys.argv[1] == "wheels":
        wheels()
    else:
        match(int(sys.argv[2]) if len(sys.argv) > 2 else 10)
