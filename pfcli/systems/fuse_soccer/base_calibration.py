"""What a log with truth says of a robot: its wheels' measures, and how far points of lines are from the lines.

Wheels: the measures for which dead reckoning over two seconds ends where the truth does, with what is known of them before
(Antonelli 2005 does so for two wheels). Points: maximum likelihood of their spread by range (Zhang 2011, section 3.2).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pfcli.core.geometry import between, compose, wrap
from pfcli.core.jit import kernel
from pfcli.core.motion import wheels
from pfcli.core.sensor.field_lines import Lines, nearest_line
from pfcli.errors import LogError
from pfcli.replay.settings import Drive

_WINDOW_S = 2.0
_YAW_M = 0.3
"""A radian of heading error counts as so many metres."""

_SCALE_SD, _WHEEL_SD, _ARM_SD, _ANGLE_SD, _MOUNT_SD = 0.1, 0.02, 0.05, math.radians(3.0), (0.1, 0.1, 0.1)
"""What is known before: all radii together, each of them, the arm (shares of the given values), an angle (rad), and where the
tracked body sits on the base (m, m, rad)."""


class Rolled(NamedTuple):
    """Wheel angles (n, k) since the start (rad) and the true pose (n, 3), at the same times (n,) since begin_ns (s); whole: bool
    (n,), whether truth was there all the time since the row before."""

    angle_rad: NDArray[np.float64]
    truth: NDArray[np.float64]
    seconds: NDArray[np.float64]
    whole: NDArray[np.bool_]
    begin_ns: int = 0


class Fit(NamedTuple):
    """The measured base, and where the tracked body sits on it (m, m, rad)."""

    drive: Drive
    mount: tuple[float, float, float]


@kernel
def _integrate(step):
    """Poses (n + 1, 3) after steps (n, 3) taken half way through their turns, from the origin."""
    out = np.zeros((step.shape[0] + 1, 3))
    for i in range(step.shape[0]):
        middle = out[i, 2] + step[i, 2] / 2
        c, s = np.cos(middle), np.sin(middle)
        out[i + 1, 0] = out[i, 0] + c * step[i, 0] - s * step[i, 1]
        out[i + 1, 1] = out[i, 1] + s * step[i, 0] + c * step[i, 1]
        out[i + 1, 2] = out[i, 2] + step[i, 2]
    return out


def dead_reckoning(rolled: Rolled, drive: Drive) -> NDArray[np.float64]:
    """Poses (n, 3) by the wheels alone, from the origin."""
    radius = np.broadcast_to(np.array(drive.radius_m), rolled.angle_rad.shape[1])
    travel = np.diff(rolled.angle_rad, axis=0) * radius
    return np.asarray(_integrate(np.ascontiguousarray(travel @ wheels.inverse(drive.jacobian()).T)))


def base_truth(rolled: Rolled, mount: tuple[float, float, float]) -> NDArray[np.float64]:
    """True poses (n, 3) of the base whose tracked body sits at `mount`."""
    x, y, yaw = mount
    c, s = math.cos(yaw), math.sin(yaw)
    return np.asarray(compose(rolled.truth, np.array([[-c * x - s * y, s * x - c * y, -yaw]])))


def error_m(rolled: Rolled, fit: Fit) -> tuple[float, float]:
    """Mean and maximum distance of dead reckoning, begun at the truth, from the truth (m)."""
    truth = base_truth(rolled, fit.mount)
    reckoned = compose(truth[:1], dead_reckoning(rolled, fit.drive))
    off = np.hypot(*(reckoned - truth)[:, :2].T)
    return float(off.mean()), float(off.max())


def _varied(nominal: Drive, p: NDArray[np.float64]) -> Fit:
    """A base that differs from the given one by p: log scale of all radii, of each, of the arms, angles, mount."""
    k = nominal.jacobian().shape[0]
    radius = np.broadcast_to(np.array(nominal.radius_m), k) * np.exp(p[0] + p[1 : 1 + k])
    arm = math.exp(p[1 + k])
    angles = tuple((np.array(nominal.angle_deg) + np.degrees(p[2 + k : -3])).tolist())
    drive = nominal._replace(
        radius_m=tuple(radius.tolist()),
        track_m=nominal.track_m * arm,
        axles_m=nominal.axles_m * arm,
        arm_m=nominal.arm_m * arm,
        angle_deg=angles,
    )
    return Fit(drive, (float(p[-3]), float(p[-2]), float(p[-1])))


def fit_wheels(runs: list[Rolled], nominal: Drive) -> Fit:
    """The base that explains the truth of all runs best, near what is given. Raises UsageError where the given one is
    none, LogError where the runs are too short."""
    k, angles = nominal.jacobian().shape[0], len(nominal.angle_deg)
    sd = np.array([_SCALE_SD, *[_WHEEL_SD] * k, _ARM_SD, *[_ANGLE_SD] * angles, *_MOUNT_SD])
    windows = [_windows(run) for run in runs]
    if not any(first.size for first, _ in windows):
        raise LogError(f"the logs hold no {_WINDOW_S:g} s of wheels and truth without a gap")
    noise = 0.02

    def miss(p: NDArray[np.float64]) -> NDArray[np.float64]:
        fit, rows = _varied(nominal, p), []
        for run, (a, b) in zip(runs, windows, strict=True):
            truth, reckoned = base_truth(run, fit.mount), dead_reckoning(run, fit.drive)
            rows.append(between(between(truth[a], truth[b]), between(reckoned[a], reckoned[b])))
        return np.asarray((np.concatenate(rows) * [1.0, 1.0, _YAW_M]).ravel())

    p = np.zeros(sd.size)
    for _ in range(3):
        found = least_squares(lambda q, s=noise: np.concatenate([_robust(miss(q) / s), q / sd]), p)
        p = np.asarray(found.x)
        noise = max(1e-4, 1.4826 * float(np.median(np.abs(miss(p)))))
    return _varied(nominal, p)


def _robust(z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Residuals whose squares grow like a Cauchy cost: slips pull less."""
    return np.asarray(np.sign(z) * np.sqrt(np.log1p(z * z / 4.0) * 4.0))


def _windows(run: Rolled) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of overlapping windows without a gap in the truth."""
    first = np.searchsorted(run.seconds, np.arange(run.seconds[0], run.seconds[-1] - _WINDOW_S, _WINDOW_S / 2))
    last = np.searchsorted(run.seconds, run.seconds[first] + _WINDOW_S)
    gaps = np.cumsum(~run.whole)
    last = np.minimum(last, run.seconds.size - 1)
    good = gaps[first] == gaps[last]
    return first[good], last[good]


def off_lines(
    rolled: Rolled, mount: tuple[float, float, float], seen: list[tuple[float, NDArray[np.float64]]], lines: Lines
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Range (n,) of each point of vision and its distance (n,) to the nearest line, at the true poses of the base.

    seen: time (s, as in `rolled`) and points (k, 2) of each frame in the base frame.
    """
    truth = base_truth(rolled, mount)
    unrolled = np.column_stack([truth[:, :2], np.unwrap(truth[:, 2])])
    ranges, distances = [np.empty(0)], [np.empty(0)]
    for seconds, points in seen:
        if not rolled.seconds[0] <= seconds <= rolled.seconds[-1] or points.size == 0:
            continue
        pose = np.array([[np.interp(seconds, rolled.seconds, unrolled[:, j]) for j in range(3)]])
        places = compose(pose, np.column_stack([points, np.zeros(len(points))]))
        ranges.append(np.hypot(points[:, 0], points[:, 1]))
        distances.append(np.array([nearest_line(lines.segments, lines.arcs, x, y)[0] for x, y, _ in places]))
    return np.concatenate(ranges), np.concatenate(distances)


BIN_M, REACH_M = 0.5, 1.0
_LEAST = 50


class Spread(NamedTuple):
    """By range: from_m (r,), points (r,), share on lines (r,), sigma_m (r,), histogram (r, 40) of distances to lines up to
    REACH_M."""

    from_m: NDArray[np.float64]
    points: NDArray[np.int64]
    hit: NDArray[np.float64]
    sigma_m: NDArray[np.float64]
    histogram: NDArray[np.int64]


def spread_by_range(range_m: NDArray[np.float64], distance_m: NDArray[np.float64]) -> Spread:
    """Maximum likelihood, for each range, of the share of points on lines and of their spread: distances (n,) to the nearest
    line are |N(0, sigma)| for those, even up to REACH_M for others. Ranges with fewer than 50 points are left out."""
    sigma = np.geomspace(0.005, 0.8, 120)[:, None]
    hit = np.linspace(0.3, 0.995, 60)[None, :]
    rows = []
    for k in range(int(range_m.max(initial=0.0) / BIN_M) + 1):
        d = distance_m[(range_m >= k * BIN_M) & (range_m < (k + 1) * BIN_M)]
        near = d[d < REACH_M]
        if near.size < _LEAST:
            continue
        log_p = np.zeros((sigma.size, hit.size))
        for value in near:
            peak = np.sqrt(2 / np.pi) / sigma * np.exp(-0.5 * (value / sigma) ** 2)
            log_p += np.log(hit * peak + (1.0 - hit) / REACH_M)
        i, j = np.unravel_index(int(np.argmax(log_p)), log_p.shape)
        counts = np.histogram(near, 40, (0.0, REACH_M))[0]
        rows.append((k * BIN_M, near.size, float(hit[0, j]), float(sigma[i, 0]), counts))
    if not rows:
        return Spread(np.empty(0), np.empty(0, np.int64), np.empty(0), np.empty(0), np.empty((0, 40), np.int64))
    start, points, share, found, counts = zip(*rows, strict=True)
    return Spread(np.array(start), np.array(points), np.array(share), np.array(found), np.array(counts))


def sigma_text(spread: Spread) -> str:
    """The spread as `--sigma` takes it."""
    middle = spread.from_m + BIN_M / 2
    return ",".join(f"{r:g}:{s:.4f}" for r, s in zip(middle, np.maximum.accumulate(spread.sigma_m), strict=True))


def rolled_of(
    stamps_ns: NDArray[np.int64],
    angle_rad: NDArray[np.float64],
    truth_ns: NDArray[np.int64],
    truth: NDArray[np.float64],
    most_gap_s: float = 0.5,
) -> Rolled:
    """Wheel angles (n, k) with the truth (m, 3) interpolated to their stamps; rows without truth around them are left out."""
    inside = (stamps_ns >= truth_ns[0]) & (stamps_ns <= truth_ns[-1])
    at, angles = stamps_ns[inside], angle_rad[inside]
    seconds, known = (at - truth_ns[0]) * 1e-9, (truth_ns - truth_ns[0]) * 1e-9
    unrolled = np.column_stack([truth[:, :2], np.unwrap(truth[:, 2])])
    poses = np.column_stack([np.interp(seconds, known, unrolled[:, j]) for j in range(3)])
    poses[:, 2] = wrap(poses[:, 2])
    after = np.minimum(np.searchsorted(known, seconds), known.size - 1)
    gap = known[after] - known[np.maximum(after - 1, 0)]
    return Rolled(angles, poses, seconds, gap <= most_gap_s, int(truth_ns[0]))
