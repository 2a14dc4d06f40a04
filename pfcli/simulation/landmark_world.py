"""A car among point landmarks: the simulation of T. Bailey that the experiments of Zhang 2016 use.

3 m/s, steering by 30 degrees at most and 20 degrees a second, wheelbase 4 m, controls every 25 ms with noise, ranges and
bearings of landmarks ahead every 200 ms. The paper's worlds (50 landmarks on 200 x 160 m, 200 on 400 x 350 m) are not public:
these are ours.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.errors import LogError, UsageError, reason
from pfcli.events import Landmarks, Odometry
from pfcli.formats import landmark_csv
from pfcli.formats.log_writer import LogWriter
from pfcli.rng import Purpose, rng_for

_EPOCH_NS = 1_600_000_000_000_000_000
_CONTROL_S, _PER_OBSERVATION, _PER_ODOMETRY = 0.025, 8, 4
_WHEELBASE_M, _MOST_STEER, _STEER_RATE, _REACHED_M = 4.0, math.radians(30.0), math.radians(20.0), 1.0


class LandmarkWorld(NamedTuple):
    """What is simulated. landmarks_xy, waypoints_xy: given places (m), or as many `landmarks` as are asked for on width x height
    and a ring of way points; the spreads are those of speed, steering, range and bearing."""

    name: str
    landmarks: int = 50
    width_m: float = 200.0
    height_m: float = 160.0
    world_seed: int = 1
    laps: int = 1
    range_m: float = 35.0
    speed_mps: float = 3.0
    speed_sd_mps: float = 0.3
    steer_sd_deg: float = 3.0
    range_sd_m: float = 0.1
    bearing_sd_deg: float = 1.0
    duration_s: float = 0.0
    landmarks_xy: tuple[tuple[float, float], ...] = ()
    waypoints_xy: tuple[tuple[float, float], ...] = ()


SCENARIOS = {
    s.name: s
    for s in (
        LandmarkWorld("landmarks-50"),
        LandmarkWorld("landmarks-200", 200, 400.0, 350.0),
        LandmarkWorld("landmarks-sample", 25, 70.0, 50.0, laps=2, range_m=20.0),
    )
}


def check(world: LandmarkWorld, where: object) -> None:
    """Raise UsageError for a world that nobody can drive in."""
    for name in ("landmarks", "width_m", "height_m", "laps", "range_m", "speed_mps"):
        if not 0 < getattr(world, name) <= 1e5:
            raise UsageError(f"{where}: field {name!r} must lie between 0 and 100000")


def described(world: LandmarkWorld) -> str:
    """What `simulate list` says of it."""
    return f"{world.landmarks} landmarks on {world.width_m:g} x {world.height_m:g} m"


def read(path: Path) -> LandmarkWorld:
    """A world from a JSON file with `landmarks_xy` and `waypoints_xy` (m): two laps with a range of 30 m, as Bailey has it."""
    try:
        found = json.loads(path.read_text())
        marks, way = (tuple((float(x), float(y)) for x, y in found[k]) for k in ("landmarks_xy", "waypoints_xy"))
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: cannot be read as a world of landmarks ({reason(error)})") from None
    except (ValueError, KeyError, TypeError) as error:
        raise LogError(
            f"{path}: is no world of landmarks: landmarks_xy and waypoints_xy are needed ({error})"
        ) from None
    if not marks or len(way) < 2:
        raise LogError(f"{path}: landmarks_xy or waypoints_xy is too short")
    return LandmarkWorld(path.stem, laps=2, range_m=30.0, landmarks_xy=marks, waypoints_xy=way)


def places(world: LandmarkWorld) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Landmarks (l, 2) and way points (w, 2); the drive begins at the origin."""
    if world.landmarks_xy:
        return np.array(world.landmarks_xy), np.array(world.waypoints_xy)
    rng = np.random.default_rng(world.world_seed)
    half = np.array([world.width_m, world.height_m]) / 2
    turn = np.linspace(0, 2 * np.pi, 13)[1:]
    middle = np.array([0.0, 0.7 * half[1]])
    ring = middle + 0.7 * half * np.column_stack([np.sin(turn), -np.cos(turn)])
    return middle + rng.uniform(-half, half, (world.landmarks, 2)), ring


NOISE = {
    "motion_xy_per_root_m": 0.0274,
    "motion_xy_m": 0.001,
    "motion_yaw_per_root_m": 0.0036,
    "motion_yaw_per_root_rad": 0.0075,
    "motion_yaw_rad": 0.0001,
    "motion_across_share": 0.01,
    "motion_pivot_m": 4.0,
}
"""Parameters of `slam-gdr --landmarks` for this car: 0.3 m/s and 3 degrees each 25 ms (in a turn, the speed's noise turns it
as well), and a pose that is its front axle's."""


class Instant(NamedTuple):
    """stamp; truth and odometry (3,); at observations: which landmarks were seen, their ranges and bearings (m, 2)."""

    stamp_ns: int
    truth: NDArray[np.float64]
    odometry: NDArray[np.float64]
    seen: NDArray[np.int64] | None = None
    z: NDArray[np.float64] | None = None


def _driven(pose: NDArray[np.float64], speed: float, steer: float) -> NDArray[np.float64]:
    yaw = pose[2]
    shift = speed * _CONTROL_S
    turned = math.remainder(yaw + shift * math.sin(steer) / _WHEELBASE_M, 2 * math.pi)
    return np.array([pose[0] + shift * math.cos(steer + yaw), pose[1] + shift * math.sin(steer + yaw), turned])


def play(world: LandmarkWorld, seed: int) -> Iterator[Instant]:
    """Drive the laps; an instant for every control."""
    rng = rng_for(seed, Purpose.SIMULATE, 0)
    marks, way = places(world)
    truth, odometry, steer = np.zeros(3), np.zeros(3), 0.0
    k, at, lap = 0, 0, 0
    while not world.duration_s or k * _CONTROL_S < world.duration_s:
        if math.hypot(*(way[at] - truth[:2])) < _REACHED_M:
            at += 1
            if at == len(way):
                at, lap = 0, lap + 1
                if lap == world.laps:
                    return
        aim = math.atan2(way[at, 1] - truth[1], way[at, 0] - truth[0]) - truth[2] - steer
        most = _STEER_RATE * _CONTROL_S
        steer += max(-most, min(most, math.remainder(aim, 2 * math.pi)))
        steer = max(-_MOST_STEER, min(_MOST_STEER, steer))
        truth = _driven(truth, world.speed_mps, steer)
        noise = rng.standard_normal(2) * [world.speed_sd_mps, math.radians(world.steer_sd_deg)]
        odometry = _driven(odometry, world.speed_mps + noise[0], steer + noise[1])
        k += 1
        stamp_ns = _EPOCH_NS + round(k * _CONTROL_S * 1e9)
        if k % _PER_OBSERVATION:
            yield Instant(stamp_ns, truth, odometry)
            continue
        d = marks - truth[:2]
        r, ahead = np.hypot(d[:, 0], d[:, 1]), d @ [math.cos(truth[2]), math.sin(truth[2])] > 0
        seen = np.flatnonzero((r < world.range_m) & ahead)
        bearing = np.arctan2(d[seen, 1], d[seen, 0]) - truth[2]
        z = np.column_stack([r[seen], bearing])
        z += rng.standard_normal(z.shape) * [world.range_sd_m, math.radians(world.bearing_sd_deg)]
        z[:, 1] = np.remainder(z[:, 1] + np.pi, 2 * np.pi) - np.pi
        yield Instant(stamp_ns, truth, odometry, seen, z)


def write(world: LandmarkWorld, seed: int, path: Path) -> dict[str, float]:
    """Write the log with truth on /ground_truth; returns counts. Odometry every 100 ms."""
    frames, way, last, end = 0, 0.0, np.zeros(3), _EPOCH_NS
    with LogWriter(path, "none") as log:
        _put_odometry(log, _EPOCH_NS, np.zeros(3))
        for k, now in enumerate(play(world, seed), 1):
            if k % _PER_ODOMETRY == 0:
                _put_odometry(log, now.stamp_ns, now.odometry)
            way += float(np.hypot(*(now.truth - last)[:2]))
            last, end = now.truth, now.stamp_ns
            if now.seen is None or now.z is None:
                continue
            x, y, yaw = (round(float(v), 4) for v in now.truth)
            log.json("/ground_truth", "pfcli.Pose2D", now.stamp_ns, x_m=x, y_m=y, yaw_rad=yaw)
            ids, unknown = tuple(str(i) for i in now.seen.tolist()), np.full((now.seen.size, 2), np.nan)
            log.landmarks(Landmarks(now.stamp_ns, ids, now.z[:, 0].round(3), now.z[:, 1].round(4), unknown))
            frames += 1
    return {"frames": frames, "way_m": round(way, 2), "span_s": (end - _EPOCH_NS) * 1e-9}


def _put_odometry(log: LogWriter, stamp_ns: int, pose: NDArray[np.float64]) -> None:
    x, y, yaw = (round(float(v), 4) for v in pose)
    log.odometry(Odometry(stamp_ns, x, y, yaw))


def write_map(world: LandmarkWorld, folder: Path, name: str) -> None:
    """Write the true landmarks beside the log, as `--landmark-map` reads them."""
    marks, _ = places(world)
    known = {str(k): (round(float(x), 4), round(float(y), 4)) for k, (x, y) in enumerate(marks)}
    landmark_csv.write(folder / f"{name}-landmarks.csv", known)
