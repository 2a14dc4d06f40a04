"""A robot of the middle-size league on its field: omni wheels, points of field lines, a compass, and what goes wrong with them.

After the experiments of Zhang 2011: 1.5 m/s, 15 frames a second, the noise of its eqs (10) and (11), three routes and that
of its fig. 4. The routes themselves are ours: the paper draws them only.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pfcli.core.geometry import between
from pfcli.core.motion import wheels
from pfcli.core.sensor.field_lines import Lines, samples
from pfcli.errors import UsageError
from pfcli.events import Heading, LinePoints
from pfcli.formats import field_yaml, map_yaml
from pfcli.formats.log_writer import LogWriter
from pfcli.rng import Purpose, rng_for

WHEEL_RADIUS_M, WHEEL_ARM_M, WHEEL_ANGLE_DEG = 0.06, 0.203, 45.0
TICKS_PER_TURN = 8192
JOINTS = ("rear_left", "front_left", "front_right", "rear_right")
ROUTES = {
    "route-1": [(-7.5, -4.5), (-3, 3.5), (0, -3), (3, 3.5), (6.5, -3.5), (7.5, 3.5), (2, 4.5), (-4, 4.5), (-7, 2)],
    "route-2": [(-6, 0), (-3, 4), (0, 0), (3, -4), (6, 0), (3, 4), (0, 0), (-3, -4), (-6, -0.5)],
    "route-3": [(-8, -5), (0, -5), (7.5, -4.5), (8, 0), (7, 4.5), (0, 5), (-5, 4)],
    "fig4": [
        (-8.6, 0),
        (-5, -1),
        (-1.5, -2.5),
        (2, -1.5),
        (2, 2),
        (-1.5, 2.8),
        (-2.5, 5),
        (0, 7),
        (3, 6.8),
        (5, 4),
        (7.5, 1),
    ],
}
_EPOCH_NS = 1_600_000_000_000_000_000
_ENCODERS_PER_FRAME = 2
_NEAR_GOAL_M, _IRON_DEG = 3.0, 90.0
_ROBOT_M = 0.25
_REACH_M = 6.5


class Soccer(NamedTuple):
    """What is simulated.

    point_noise: spread of a line point per range, eq. (10); false_share: of points that are on no line; range_scale: what
    vision takes a metre for; robots: others on the field, which hide lines; shift_noise, turn_noise: spread of the motion of
    a frame per its size, eq. (11); slip_every_s: one wheel slips through by slip_m; collide_every_s: pushed by 0.4 m and 25
    deg, unseen by wheels; kidnap_every_s: put down anywhere; compass_noise_deg, compass_bias_deg; bent: iron near the goals
    bends the compass; landmarks: goal posts and crossings are detected as well.
    """

    name: str
    field: str = "msl-18x12"
    route: str = "route-1"
    speed_mps: float = 1.5
    frame_hz: float = 15.0
    points: int = 100
    point_noise: float = 0.043
    false_share: float = 0.0
    range_scale: float = 1.0
    robots: int = 0
    shift_noise: float = 0.92
    turn_noise: float = 0.48
    slip_every_s: float = 0.0
    slip_m: float = 0.3
    collide_every_s: float = 0.0
    kidnap_every_s: float = 0.0
    compass_noise_deg: float = 5.0
    compass_bias_deg: float = 0.0
    bent: bool = False
    landmarks: bool = False
    duration_s: float = 0.0


SCENARIOS = {
    s.name: s
    for s in (
        *(Soccer(f"soccer-{name}", route=name) for name in ROUTES),
        Soccer("soccer-false-points", point_noise=0.086, false_share=0.3, shift_noise=1.84, turn_noise=0.96),
        Soccer("soccer-range-scale", range_scale=1.05),
        Soccer("soccer-occluded", robots=9),
        Soccer("soccer-bent-compass", bent=True, compass_bias_deg=12.0),
        Soccer("soccer-slips", shift_noise=0.05, turn_noise=0.05, slip_every_s=3.0),
        Soccer("soccer-collisions", shift_noise=0.05, turn_noise=0.05, collide_every_s=5.0),
        Soccer("soccer-kidnap", kidnap_every_s=8.0),
        Soccer("soccer-landmarks", points=20, landmarks=True),
        Soccer("soccer-landmarks-only", points=0, landmarks=True),
        Soccer("soccer-sample", route="fig4", points=30, frame_hz=10.0, robots=3, bent=True, landmarks=True),
    )
}


def check(scenario: Soccer, where: object) -> None:
    """Raise UsageError for a match that cannot be played."""
    if scenario.route not in ROUTES:
        raise UsageError(f"{where}: {scenario.route!r} is none of {', '.join(ROUTES)}")
    step_s = 1.0 / (max(scenario.frame_hz, 1e-9) * _ENCODERS_PER_FRAME)
    for name in ("speed_mps", "frame_hz", "range_scale"):
        if not 0.0 < getattr(scenario, name) <= 1000.0:
            raise UsageError(f"{where}: field {name!r} must lie between 0 and 1000")
    for name in ("slip_every_s", "collide_every_s", "kidnap_every_s"):
        if 0.0 < getattr(scenario, name) < step_s:
            raise UsageError(f"{where}: field {name!r} is shorter than a step of {step_s:.3f} s")
    if scenario.false_share > 1.0:
        raise UsageError(f"{where}: field 'false_share' must lie between 0 and 1")


def described(scenario: Soccer) -> str:
    """What `simulate list` says of it."""
    return f"field {scenario.field}, {scenario.route}, {scenario.points} points a frame"


class Instant(NamedTuple):
    """stamp; true pose (3,); travel (4,) of the wheels since the start (m); at frames: points (n, 2) of lines (m, base
    frame), landmarks as (kind, range, bearing), heading that the compass reads (rad)."""

    stamp_ns: int
    truth: NDArray[np.float64]
    travel_m: NDArray[np.float64]
    points_m: NDArray[np.float64] | None = None
    landmarks: tuple[tuple[str, float, float], ...] = ()
    compass_rad: float = math.nan


def _path(scenario: Soccer, rng: np.random.Generator) -> Iterator[NDArray[np.float64]]:
    """True poses at the encoders' rate along a smooth curve; the robot looks about the opponents' goal. NaN rows before a
    pose that the wheels do not notice."""
    way = np.array(ROUTES[scenario.route], float)
    at = np.r_[0.0, np.cumsum(np.hypot(*np.diff(way, axis=0).T))]
    curve = CubicSpline(at, way)
    fine = np.linspace(0.0, at[-1], 4000)
    length = np.r_[0.0, np.cumsum(np.hypot(*np.diff(curve(fine), axis=0).T))]
    dt = 1.0 / (scenario.frame_hz * _ENCODERS_PER_FRAME)
    end = length[-1] / scenario.speed_mps
    phase, offset = rng.uniform(0, 2 * math.pi), np.zeros(3)
    started, legs = 0.0, 0
    for k in range(int((scenario.duration_s or end) / dt)):
        t = k * dt
        along = min((t + started) * scenario.speed_mps, length[-1])
        x, y = curve(np.interp(along, length, fine))
        yaw = math.atan2(-y, 12.0 - x) + 1.2 * math.sin(2 * math.pi * t / 7.0 + phase)
        if scenario.collide_every_s and k and k % round(scenario.collide_every_s / dt) == 0:
            side = rng.uniform(0, 2 * math.pi)
            push = 0.4 * math.cos(side), 0.4 * math.sin(side), math.radians(25.0) * rng.choice([-1.0, 1.0])
            offset = offset + np.array(push)
            yield np.full(3, np.nan)
        if scenario.kidnap_every_s and k and k % round(scenario.kidnap_every_s / dt) == 0:
            started = rng.uniform(0.0, 0.8 * end) - t
            legs += 1
            offset[2] = rng.uniform(-math.pi, math.pi)
            yield np.full(3, np.nan)
            along = (t + started) * scenario.speed_mps
            x, y = curve(np.interp(along, length, fine))
        yield np.array([x, y, yaw]) + offset
        if not legs:
            offset = offset * math.exp(-dt / 2.0)


class Vision:
    """What the camera sees of the field."""

    def __init__(self, scenario: Soccer, rng: np.random.Generator) -> None:
        self._scenario, self._rng = scenario, rng
        field = field_yaml.read(scenario.field)
        self._marks = field.landmarks
        self._lines = _dense(field.lines)
        self._others = rng.uniform(field.lines.low, field.lines.high, (scenario.robots, 2))
        self._speed = rng.normal(0.0, 1.0, (scenario.robots, 2))
        self._low, self._high = field.lines.low, field.lines.high

    def others_move(self, seconds: float) -> None:
        """The other robots run straight and turn back at the border."""
        self._others += self._speed * seconds
        out = (self._others < self._low) | (self._others > self._high)
        self._speed[out] *= -1.0

    def points(self, truth: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) points of lines in the base frame."""
        scenario, rng = self._scenario, self._rng
        seen = self._visible(truth, self._lines)
        wanted = min(scenario.points, seen.shape[0])
        false = int(rng.binomial(wanted, scenario.false_share)) if scenario.false_share else 0
        chosen = np.sort(rng.choice(seen.shape[0], wanted - false, replace=False)) if seen.size else np.empty(0, int)
        points = seen[chosen]
        sigma = scenario.point_noise * np.hypot(points[:, 0], points[:, 1])
        points = points + sigma[:, None] * rng.standard_normal(points.shape)
        r, angle = _REACH_M * np.sqrt(rng.random(false)), rng.uniform(0, 2 * np.pi, false)
        points = np.concatenate([points, np.column_stack([r * np.cos(angle), r * np.sin(angle)])])
        return points * scenario.range_scale

    def landmarks(self, truth: NDArray[np.float64]) -> Iterator[tuple[str, float, float]]:
        """Kind, range and bearing of what is near enough; vision names kinds, not places."""
        scenario, rng = self._scenario, self._rng
        for mark in self._marks:
            seen = self._visible(truth, np.array([[mark.x_m, mark.y_m]]))
            if seen.size and mark.kind != "spot" and rng.random() < 0.7:
                noisy = seen[0] + scenario.point_noise * np.hypot(*seen[0]) * rng.standard_normal(2)
                yield mark.kind, scenario.range_scale * float(np.hypot(*noisy)), math.atan2(noisy[1], noisy[0])

    def _visible(self, truth: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places (k, 2) within reach and not behind another robot, in the base frame."""
        near = np.hypot(places[:, 0] - truth[0], places[:, 1] - truth[1]) < _REACH_M
        rows = np.column_stack([places[near], np.zeros(int(near.sum()))])
        seen = between(truth[None], rows)[:, :2] if rows.size else np.empty((0, 2))
        for other in self._others:
            at = between(truth[None], np.array([[other[0], other[1], 0.0]]))[0, :2]
            far = float(np.hypot(*at))
            if far < 2 * _ROBOT_M:
                continue
            off = np.abs(
                np.remainder(np.arctan2(seen[:, 1], seen[:, 0]) - math.atan2(at[1], at[0]) + np.pi, 2 * np.pi) - np.pi
            )
            seen = seen[(off > math.asin(_ROBOT_M / far)) | (np.hypot(seen[:, 0], seen[:, 1]) < far)]
        return seen


def _dense(lines: Lines) -> NDArray[np.float64]:
    """Points on the lines, closer together than samples of the filter's model are."""
    rough = samples(lines)
    step = np.diff(rough, axis=0)
    close = np.hypot(step[:, 0], step[:, 1]) < 0.5
    return np.concatenate([rough, *(rough[:-1][close] + share * step[close] for share in (0.2, 0.4, 0.6, 0.8))])


def play(scenario: Soccer, seed: int) -> Iterator[Instant]:
    """Drive the scenario."""
    path, eyes, odo, needle = (rng_for(seed, Purpose.SIMULATE, k) for k in range(4))
    vision = Vision(scenario, eyes)
    places = wheels.four_places(math.radians(WHEEL_ANGLE_DEG))
    jacobian = wheels.omni(places, [WHEEL_ARM_M] * 4)
    travel, last, k = np.zeros(4), None, 0
    dt = 1.0 / (scenario.frame_hz * _ENCODERS_PER_FRAME)
    # the noise of eq. (11) is that of a frame; the encoders report parts of it
    share = math.sqrt(_ENCODERS_PER_FRAME)
    for true in _path(scenario, path):
        if np.isnan(true[0]):
            last = None
            continue
        if last is not None:
            moved = wheels.midway(between(last[None], true[None])[0])
            size = float(np.hypot(moved[0], moved[1]))
            sd = share * np.array([scenario.shift_noise * size] * 2 + [scenario.turn_noise * abs(moved[2])])
            travel = travel + jacobian @ (moved + sd * odo.standard_normal(3))
        if scenario.slip_every_s and k and k % round(scenario.slip_every_s / dt) == 0:
            travel = travel + scenario.slip_m * np.eye(4)[int(odo.integers(4))]
        last = true
        stamp_ns = _EPOCH_NS + round(k * dt * 1e9)
        vision.others_move(dt)
        if k % _ENCODERS_PER_FRAME == 0:
            marks = tuple(vision.landmarks(true)) if scenario.landmarks else ()
            yield Instant(stamp_ns, true, travel, vision.points(true), marks, _compass(scenario, true, needle))
        else:
            yield Instant(stamp_ns, true, travel)
        k += 1


def _compass(scenario: Soccer, true: NDArray[np.float64], rng: np.random.Generator) -> float:
    reading = true[2] + math.radians(scenario.compass_bias_deg + scenario.compass_noise_deg * rng.standard_normal())
    if scenario.bent:
        near = max(0.0, 1.0 - math.hypot(abs(true[0]) - 9.0, true[1]) / _NEAR_GOAL_M)
        reading += math.radians(_IRON_DEG) * near
    return math.remainder(reading, 2 * math.pi)


def write(scenario: Soccer, seed: int, path: Path) -> dict[str, float]:
    """Write the log with truth on /ground_truth; returns counts. Rounded to 1 mm and 1e-4 rad so that CPU types agree."""
    frames, way, last, end = 0, 0.0, None, _EPOCH_NS
    with LogWriter(path, "none") as log:
        for now in play(scenario, seed):
            _put(log, now)
            frames += now.points_m is not None
            way += float(np.hypot(*(now.truth - last)[:2])) if last is not None else 0.0
            last, end = now.truth, now.stamp_ns
    return {"frames": frames, "way_m": round(way, 2), "span_s": (end - _EPOCH_NS) * 1e-9}


def _put(log: LogWriter, now: Instant) -> None:
    turn = 2 * math.pi * WHEEL_RADIUS_M / TICKS_PER_TURN
    ticks = {"names": list(JOINTS), "ticks": np.rint(now.travel_m / turn).astype(int).tolist()}
    log.json("/encoders", "pfcli.WheelEncoders", now.stamp_ns, **ticks, ticks_per_turn=TICKS_PER_TURN)
    x, y, yaw = (round(float(v), 4) for v in now.truth)
    log.json(
        "/ground_truth", "pfcli.Pose2D", now.stamp_ns, x_m=x, y_m=y, yaw_rad=round(math.remainder(yaw, 2 * math.pi), 4)
    )
    if now.points_m is None:
        return
    log.heading(Heading(now.stamp_ns, now.compass_rad, math.nan))
    log.line_points(LinePoints(now.stamp_ns, now.points_m))
    if now.landmarks:
        rows = [{"id": name, "range_m": round(r, 3), "bearing_rad": round(b, 4)} for name, r, b in now.landmarks]
        log.json("/landmarks", "pfcli.Landmarks", now.stamp_ns, landmarks=rows)


def write_map(scenario: Soccer, folder: Path, name: str) -> None:
    """Write the field as a map beside the log."""
    map_yaml.write(folder, field_yaml.drawn(field_yaml.read(scenario.field)), name)
