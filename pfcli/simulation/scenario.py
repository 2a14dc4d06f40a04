"""A scenario: world, robot, scanner and crowd, from a TOML file or by name, written as a log with truth."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.errors import UsageError
from pfcli.events import Odometry, Pose2, Scan
from pfcli.formats import map_yaml
from pfcli.formats.log_writer import LogWriter
from pfcli.rng import Purpose, rng_for
from pfcli.simulation.indoor_world import WORLDS, World, known_part, rasterize
from pfcli.simulation.laser import LASERS, Laser, cast, rings
from pfcli.simulation.robot import ROBOTS, STEP_S, WheelOdometry, drive

WHEEL_RADIUS_M, TICKS_PER_TURN = 0.1, 2000
_EPOCH_NS = 1_600_000_000_000_000_000
_FINDERS = ("left", "right")
_CARRIED_M = 0.5
"""Between two instants nobody drives so far: the robot was carried."""


class Scenario(NamedTuple):
    """What is simulated.

    people: how many walk about; people_keep_m: nearer to the scanner they are not (they step aside); duration_s: stop
    after so long (0: when the route ends); rate_hz: of the scanner (0: its own); odometry_hz: of odometry and truth;
    encoding: `ros2` (CDR, odometry) or `json` (wheel ticks, no ROS); known_share: how much of the world's width, from
    the west, the partial map covers; range_finders_deg: two range finders look forward at this angle to each side (0: none).
    """

    name: str
    world: str = "office"
    robot: str = "pioneer"
    laser: str = "sick-1deg"
    world_seed: int = 1
    people: int = 0
    duration_s: float = 0.0
    rate_hz: float = 0.0
    odometry_hz: float = 20.0
    encoding: str = "ros2"
    known_share: float = 1.0
    people_keep_m: float = 0.0
    range_finders_deg: float = 0.0


RANGE_FINDER = Laser(1, 0.0, 8.0, 0.02, (0.15, 0.0, 0.0), 5.0)
"""What looks forward beside the scanner, after Zhang 2014, fig. 7 (its range and mounting angles are not given)."""


SCENARIOS = {
    s.name: s
    for s in (
        Scenario("small-loop", "small-loop", "pioneer", "sick-1deg", rate_hz=4.0, odometry_hz=4.0),
        Scenario("no-ros", "small-loop", "pioneer", "coarse-240", 2, 3, 90.0, 4.0, 4.0, "json"),
        Scenario("office", "office"),
        Scenario("paper-40x25", "paper-40x25", "pioneer", "urg-04lx"),
        Scenario("paper-40x25-long", "paper-40x25", "pioneer", "sick-1deg"),
        Scenario("paper-60x50", "paper-60x50", "pioneer", "urg-04lx"),
        Scenario("paper-60x50-long", "paper-60x50", "pioneer", "sick-1deg"),
        Scenario("loop-500m", "loop-500m"),
        Scenario("loop-2km", "loop-2km"),
        Scenario("half-degree", "office", "pioneer", "sick-half"),
        Scenario("quarter-degree", "office", "pioneer", "quarter"),
        Scenario("narrow-view", "office", "pioneer", "narrow"),
        Scenario("full-circle", "office", "pioneer", "ring-360"),
        Scenario("off-centre", "office", "pioneer", "off-centre"),
        Scenario("rings", "office", "pioneer", "rings-16"),
        Scenario("slips", "office", "slips"),
        Scenario("wheel-5-percent", "office", "wheel-5-percent"),
        Scenario("people", "office", people=12),
        Scenario("four-rooms", "four-rooms", laser="ring-360", encoding="json", range_finders_deg=30.0),
        Scenario("four-rooms-same", "four-rooms-same", laser="ring-360", encoding="json", range_finders_deg=30.0),
        Scenario(
            "four-rooms-sample",
            "four-rooms",
            "pioneer",
            "coarse-240",
            1,
            0,
            70.0,
            2.0,
            5.0,
            "json",
            range_finders_deg=30.0,
        ),
        Scenario("reliable-kidnap", "office-carried"),
        Scenario("reliable-20", "office-boxes-few"),
        Scenario("reliable-40", "office-boxes-some"),
        Scenario("reliable-60", "office-boxes-many"),
        Scenario("reliable-crowd", "office", people=25, people_keep_m=0.6),
        Scenario("reliable-sample", "office-carried", duration_s=150.0, rate_hz=2.0, odometry_hz=4.0),
        Scenario("partial-leave", "partial-leave", known_share=0.5),
        Scenario("partial-enter", "partial-enter", known_share=0.5),
        Scenario("partial-other-way", "partial-other-way", known_share=0.5),
        Scenario("partial-loops", "partial-loops", known_share=0.5),
        Scenario("partial-never", "partial-never", known_share=0.5),
        Scenario("partial-kidnap", "partial-kidnap", known_share=0.5),
        Scenario("partial-symmetric", "partial-symmetric", known_share=0.6),
        Scenario("partial-crowd", "partial-leave", people=20, known_share=0.5, people_keep_m=1.0),
        Scenario("partial-30", "partial-loops", known_share=0.3),
        Scenario("partial-70", "partial-loops", known_share=0.7),
        Scenario("partial-90", "partial-loops", known_share=0.9),
        Scenario("partial-furnished", "partial-furnished", known_share=0.5),
        Scenario("partial-furnished-stay", "office-boxes-some", known_share=0.95),
        Scenario("partial-drive-1", "partial-drive-1", "pioneer", "urg-04lx"),
        Scenario("partial-drive-2", "partial-drive-2", "pioneer", "urg-04lx"),
        Scenario("partial-sample", "partial-leave", rate_hz=4.0, odometry_hz=4.0, known_share=0.5),
    )
}


def check(scenario: Scenario, where: object) -> None:
    """Raise UsageError for a scenario that names what there is not."""
    for value, table in ((scenario.world, WORLDS), (scenario.robot, ROBOTS), (scenario.laser, LASERS)):
        if value not in table:
            raise UsageError(f"{where}: {value!r} is none of {', '.join(table)}")
    if LASERS[scenario.laser].rings_deg and scenario.encoding == "json":
        raise UsageError(f"{where}: point clouds of the laser {scenario.laser!r} need encoding ros2")


def described(scenario: Scenario) -> str:
    """What `simulate list` says of it."""
    people = f", {scenario.people} people" if scenario.people else ""
    return f"world {scenario.world}, robot {scenario.robot}, laser {scenario.laser}{people}"


class Reading(NamedTuple):
    """One instant: stamp, truth, odometry, way of each wheel (m), and a scan's ranges where one is due; ahead_m: what the
    range finders read then, left and right."""

    stamp_ns: int
    truth: tuple[float, float, float]
    odometry: tuple[float, float, float]
    wheels_m: tuple[float, float]
    ranges_m: NDArray[np.float32] | None
    ahead_m: NDArray[np.float32] | None = None


def play(scenario: Scenario, seed: int) -> Iterator[Reading]:
    """Drive the scenario; everything is rounded to 1 mm and 1e-4 rad so that CPU types agree."""
    world = WORLDS[scenario.world](scenario.world_seed)
    standing = np.concatenate([world.walls, world.unmapped])
    robot, laser = ROBOTS[scenario.robot], _laser(scenario)
    rng = rng_for(seed, Purpose.SIMULATE, 0)
    odometer = WheelOdometry(robot, rng)
    crowd = _Crowd(world, scenario.people, rng_for(seed, Purpose.SIMULATE, 1))
    finders = rng_for(seed, Purpose.SIMULATE, 2)
    every = max(1, round(1.0 / (laser.rate_hz * STEP_S)))
    offsets = _angles(laser)
    ranges, last = np.empty(laser.beams), None
    for k, true in enumerate(drive(world.route, robot)):
        if scenario.duration_s and k * STEP_S > scenario.duration_s:
            return
        if last is not None and math.hypot(true[0] - last[0], true[1] - last[1]) > _CARRIED_M:
            odometer.carried(true)
        odometry, last = odometer(true), true
        crowd.walk(STEP_S)
        seen, ahead = None, None
        if k % every == 0:
            sx, sy, syaw = _compose(true, laser.mount)
            near = np.hypot(crowd.discs[:, 0] - sx, crowd.discs[:, 1] - sy) < scenario.people_keep_m
            cast(sx, sy, offsets + syaw, standing, crowd.discs[~near], laser.range_m, ranges)
            true_m = rings(ranges, laser) if laser.rings_deg else ranges
            noisy = np.round(true_m + laser.noise_m * rng.standard_normal(true_m.shape), 3)
            seen = np.where(true_m >= laser.range_m, np.inf, np.clip(noisy, 0.02, None)).astype(np.float32)
            if scenario.range_finders_deg:
                ahead = _ahead(scenario, true, standing, crowd.discs, finders)
        stamp_ns = _EPOCH_NS + round(k * STEP_S * 1e9)
        yield Reading(stamp_ns, _rounded(true), _rounded(odometry), odometer.wheels_m, seen, ahead)


def _ahead(
    scenario: Scenario,
    true: tuple[float, float, float],
    walls: NDArray[np.float64],
    discs: NDArray[np.float64],
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """What the range finders read."""
    x, y, yaw = _compose(true, RANGE_FINDER.mount)
    side, out = math.radians(scenario.range_finders_deg), np.empty(2)
    cast(x, y, np.array([yaw + side, yaw - side]), walls, discs, RANGE_FINDER.range_m, out)
    noisy = np.round(out + RANGE_FINDER.noise_m * rng.standard_normal(2), 3)
    return np.where(out >= RANGE_FINDER.range_m, np.inf, np.clip(noisy, 0.02, None)).astype(np.float32)


def _laser(scenario: Scenario) -> Laser:
    laser = LASERS[scenario.laser]
    return laser._replace(rate_hz=scenario.rate_hz) if scenario.rate_hz else laser


def _angles(laser: Laser) -> NDArray[np.float64]:
    low, step = _angle_grid(laser)
    return np.asarray(low + step * np.arange(laser.beams), np.float64)


def _angle_grid(laser: Laser) -> tuple[float, float]:
    return -math.radians(laser.view_deg) / 2, math.radians(laser.view_deg) / (laser.beams - 1)


def _compose(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2]


def _rounded(pose: tuple[float, float, float]) -> tuple[float, float, float]:
    return round(pose[0], 3), round(pose[1], 3), round(pose[2], 4)


class _Crowd:
    """Discs that walk along the route and back, at 1 m/s, off its middle."""

    def __init__(self, world: World, people: int, rng: np.random.Generator) -> None:
        self._route = world.route[np.isfinite(world.route[:, 0])]
        self._at = rng.uniform(0, max(1, len(self._route) - 1), people)
        self._side = rng.uniform(-0.6, 0.6, (people, 2))
        self._sign = np.where(rng.random(people) < 0.5, -1.0, 1.0)
        self.discs = np.zeros((people, 3))
        self.walk(0.0)

    def walk(self, seconds: float) -> None:
        """Move everybody."""
        last = len(self._route) - 1
        for k in range(self._at.size):
            leg = min(int(self._at[k]), last - 1)
            a, b = self._route[leg], self._route[leg + 1]
            length = max(0.1, math.hypot(b[0] - a[0], b[1] - a[1]))
            self._at[k] += self._sign[k] * seconds / length
            if not 0.0 <= self._at[k] <= last:
                self._sign[k] *= -1
                self._at[k] = min(max(self._at[k], 0.0), last)
            leg = min(int(self._at[k]), last - 1)
            share = self._at[k] - leg
            a, b = self._route[leg], self._route[leg + 1]
            self.discs[k, :2] = a + share * (b - a) + self._side[k]
            self.discs[k, 2] = 0.25


def write(scenario: Scenario, seed: int, path: Path) -> dict[str, float]:
    """Write the log (uncompressed chunks, truth on /ground_truth); returns counts."""
    laser = _laser(scenario)
    every = max(1, round(1.0 / (scenario.odometry_hz * STEP_S)))
    put = _put_json if scenario.encoding == "json" else _put_ros2
    scans, way, last, end = 0, 0.0, None, _EPOCH_NS
    with LogWriter(path, "none") as log:
        log.tf_static(_EPOCH_NS, _mounts(scenario, laser), {"laser": laser.height_m})
        for k, reading in enumerate(play(scenario, seed)):
            put(log, reading, laser, k % every == 0)
            scans += reading.ranges_m is not None
            way += math.hypot(reading.truth[0] - last[0], reading.truth[1] - last[1]) if last else 0.0
            last, end = reading.truth, reading.stamp_ns
    return {"scans": scans, "way_m": round(way, 2), "span_s": (end - _EPOCH_NS) * 1e-9}


def _mounts(scenario: Scenario, laser: Laser) -> list[tuple[str, str, Pose2]]:
    x, y, _ = RANGE_FINDER.mount
    mounts = [("base_link", "laser", Pose2(*laser.mount))]
    if scenario.range_finders_deg:
        side = round(math.radians(scenario.range_finders_deg), 9)
        mounts += [("base_link", "range_left", Pose2(x, y, side)), ("base_link", "range_right", Pose2(x, y, -side))]
    return mounts


def _put_ros2(log: LogWriter, reading: Reading, laser: Laser, odometry_due: bool) -> None:
    if odometry_due:
        log.odometry(Odometry(reading.stamp_ns, *reading.odometry))
        log.pose(reading.stamp_ns, reading.truth)
    if reading.ranges_m is not None:
        _put_scan(log, reading.stamp_ns, reading.ranges_m, laser)
    if reading.ahead_m is not None:
        for name, r in zip(_FINDERS, reading.ahead_m, strict=True):
            log.range_finder(reading.stamp_ns, float(r), (0.02, RANGE_FINDER.range_m), name)


def _put_scan(log: LogWriter, stamp_ns: int, ranges_m: NDArray[np.float32], laser: Laser) -> None:
    """A scan of one plane, or the points of many."""
    if not laser.rings_deg:
        low, step = _angle_grid(laser)
        log.scan(Scan(stamp_ns, ranges_m, low, step, 0.02, laser.range_m, Pose2()))
        return
    angle, up = _angles(laser)[None, :], np.radians(np.array(laser.rings_deg))[:, None]
    r = np.where(np.isfinite(ranges_m), ranges_m, np.nan).astype(np.float64)
    points = [r * np.cos(up) * np.cos(angle), r * np.cos(up) * np.sin(angle), r * np.sin(up) + 0.0 * angle]
    log.cloud(stamp_ns, np.round(np.stack(points, axis=-1), 3))


def _put_json(log: LogWriter, reading: Reading, laser: Laser, odometry_due: bool) -> None:
    if odometry_due:
        ticks = [round(way / (2 * math.pi * WHEEL_RADIUS_M) * TICKS_PER_TURN) for way in reading.wheels_m]
        wheels = {"names": ["left", "right"], "ticks": ticks, "ticks_per_turn": TICKS_PER_TURN}
        log.json("/encoders", "pfcli.WheelEncoders", reading.stamp_ns, **wheels)
        x, y, yaw = reading.truth
        log.json("/ground_truth", "pfcli.Pose2D", reading.stamp_ns, x_m=x, y_m=y, yaw_rad=yaw)
    if reading.ranges_m is not None:
        low, step = _angle_grid(laser)
        ranges = [round(float(r), 3) if math.isfinite(r) else None for r in reading.ranges_m]
        angles = {"angle_min_rad": round(low, 9), "angle_increment_rad": round(step, 9)}
        limits = {"range_min_m": 0.02, "range_max_m": laser.range_m, "frame_id": "laser"}
        log.json("/scan", "pfcli.LaserScan", reading.stamp_ns, ranges_m=ranges, **angles, **limits)
    if reading.ahead_m is not None:
        for name, r in zip(_FINDERS, reading.ahead_m, strict=True):
            value = {"range_m": round(float(r), 3) if math.isfinite(r) else None, "frame_id": f"range_{name}"}
            limits = {"range_min_m": 0.02, "range_max_m": RANGE_FINDER.range_m}
            log.json(f"/range/{name}", "pfcli.Range", reading.stamp_ns, **value, **limits)


def write_map(scenario: Scenario, folder: Path, name: str) -> None:
    """Write the true map beside the log."""
    map_yaml.write(folder, rasterize(WORLDS[scenario.world](scenario.world_seed), 0.05), name)


def write_partial_map(scenario: Scenario, folder: Path, name: str) -> None:
    """Write the map that the robot has been given: what it could reach, and of that the western share."""
    world = WORLDS[scenario.world](scenario.world_seed)
    map_yaml.write(folder, known_part(rasterize(world, 0.05), world, scenario.known_share), name)
