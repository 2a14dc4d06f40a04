"""What a drive says of clocks and calibration: its scans as end points in the scanner's frame, and its motion."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.grid import scan_pairs
from pfcli.core.grid.scan_pairs import Surface, surface_of
from pfcli.core.motion.clock_offset import Turns
from pfcli.core.motion.drive_calibration import Motions
from pfcli.dropped import Dropped
from pfcli.events import Scan, Truth
from pfcli.replay.align import ROLES as MOTION_ROLES
from pfcli.replay.dead_reckoning import DeadReckoning
from pfcli.replay.log import Log
from pfcli.replay.scan_times import ScanTimes
from pfcli.replay.settings import Drive

_SECOND = 1_000_000_000
_BEAMS, _SCANS = 240, 4000
"""So many end points of a scan tell its pose; so many scans of a drive its calibration."""
_APART_S, _LONG_S = 0.15, 1.5
_NEAR_TURN_S, _TURNING_RAD = 1.2, 0.05
_PAIRS, _SHARE = 1800, 0.4
_STEP_S, _STILL_M = 0.3, 0.02
_TURN_M = 0.2
"""A radian turned rolls wheels so far."""
_GUESSES = np.radians([0.0, -12.0, 12.0, -24.0, 24.0])


class DriveRecord(NamedTuple):
    """Times are seconds after begin_ns. scan_s: (n,) of the scans' middle beams; surfaces: of each; mount (3,): of the scanner as
    the log says; motion_s (k,), odometry (k, 3) with headings without jumps; rolled (k, w): how far each wheel has rolled (m),
    w = 0 without wheels; truth_s (t,), truth (t, 3)."""

    begin_ns: int
    scan_s: NDArray[np.float64]
    surfaces: list[Surface]
    mount: NDArray[np.float64]
    motion_s: NDArray[np.float64]
    odometry: NDArray[np.float64]
    rolled: NDArray[np.float64]
    truth_s: NDArray[np.float64]
    truth: NDArray[np.float64]


def record(log: Log, motion: str, drive: Drive, roles: tuple[str, ...] = ("scan",)) -> DriveRecord:
    """Read a drive, as much of it as its first scans span. Raises LogError and UsageError as a replay does."""
    reckon = DeadReckoning(motion, drive, Dropped())
    times = ScanTimes(log.settings.deskew, Dropped())
    scans: list[tuple[int, Surface]] = []
    moved: list[tuple[int, tuple[float, ...], NDArray[np.float64]]] = []
    true: list[Truth] = []
    mount = np.zeros(3)
    for event in log.events([*MOTION_ROLES[motion], *roles]):
        if isinstance(event, Scan):
            surface = _surface(event)
            if surface is not None:
                first, last = times.span_ns(event)
                scans.append((event.stamp_ns + (first + last) // 2, surface))
                mount = np.array(event.mount, np.float64)
        elif isinstance(event, Truth):
            true.append(event)
        else:
            pose = reckon(event)
            if pose is not None:
                moved.append(
                    (pose.stamp_ns, tuple(pose[1:4]), reckon.rolled[0].copy() if reckon.rolled.size else np.empty(0))
                )
        if len(scans) >= _SCANS:
            break
    begin = min([*(stamp for stamp, _ in scans[:1]), *(stamp for stamp, *_ in moved[:1])], default=0)
    odometry = np.array([row for _, row, _ in moved], np.float64).reshape(-1, 3)
    odometry[:, 2] = np.unwrap(odometry[:, 2])
    truth = np.array([t[1:4] for t in true], np.float64).reshape(-1, 3)
    truth[:, 2] = np.unwrap(truth[:, 2])
    return DriveRecord(
        begin_ns=begin,
        scan_s=np.array([(stamp - begin) / _SECOND for stamp, _ in scans]),
        surfaces=[surface for _, surface in scans],
        mount=mount,
        motion_s=np.array([(stamp - begin) / _SECOND for stamp, *_ in moved]),
        odometry=odometry,
        rolled=np.array([rolled for *_, rolled in moved], np.float64),
        truth_s=np.array([(t.stamp_ns - begin) / _SECOND for t in true]),
        truth=truth,
    )


def _surface(scan: Scan) -> Surface | None:
    """End points in the scanner's frame."""
    every = -(-scan.ranges_m.size // _BEAMS) or 1
    r, angle = scan.ranges_m[::every].astype(np.float64), scan.angles_rad(every)
    hit = np.isfinite(r) & (r > scan.range_min_m) & (r < scan.range_max_m)
    if hit.sum() < 20:
        return None
    return surface_of(np.stack([r[hit] * np.cos(angle[hit]), r[hit] * np.sin(angle[hit])], axis=1))


def pairs_of(scan_s: NDArray[np.float64], apart_s: float = _APART_S) -> NDArray[np.int64]:
    """(p, 2) scans that follow each other, `apart_s` or more apart, and no pause in between."""
    later = np.searchsorted(scan_s, scan_s + apart_s)
    first = np.flatnonzero(later < scan_s.size)
    found = np.stack([first, later[first]], axis=1)
    return np.asarray(found[scan_s[found[:, 1]] - scan_s[found[:, 0]] < _LONG_S])


def turns_of(drive: DriveRecord) -> Turns:
    """How far the scanner turned between scans, by the scans, wherever the motion turns nearby."""
    yaw, t = drive.odometry[:, 2], drive.motion_s
    pairs = pairs_of(drive.scan_s)
    if t.size < 2 or len(pairs) == 0:
        return Turns(*np.empty((4, 0)))
    start, end = drive.scan_s[pairs[:, 0]], drive.scan_s[pairs[:, 1]]
    beside = np.interp(end + _NEAR_TURN_S, t, yaw) - np.interp(start - _NEAR_TURN_S, t, yaw)
    changes = np.abs(beside) + np.abs(np.interp(end, t, yaw) - np.interp(start, t, yaw))
    chosen = np.flatnonzero(changes > _TURNING_RAD)
    chosen = chosen[:: max(1, -(-chosen.size // _PAIRS))]
    steps = np.diff(drive.odometry, axis=0)
    rolled = np.hypot(steps[:, 0], steps[:, 1]) + _TURN_M * np.abs(steps[:, 2])
    along = np.concatenate([[0.0], np.cumsum(rolled)])
    ways = np.interp(end, t, along) - np.interp(start, t, along)
    rows = []
    for k in chosen.tolist():
        turned = float(np.interp(end[k], t, yaw) - np.interp(start[k], t, yaw))
        guesses = np.zeros((_GUESSES.size + 1, 3))
        guesses[:, 2] = [turned, *_GUESSES]
        pair = scan_pairs.best_of(drive.surfaces[pairs[k, 0]], drive.surfaces[pairs[k, 1]].points, guesses)
        if pair.share > _SHARE:
            rows.append((start[k], end[k], pair.pose[2], ways[k]))
    found = np.array(rows, np.float64).reshape(-1, 4)
    return Turns(*found.T)


def chain_of(at_s: NDArray[np.float64], apart_s: float) -> NDArray[np.int64]:
    """(p, 2) instants that follow each other without overlap, `apart_s` or more apart, and no pause in between."""
    kept, last = [], -np.inf
    for k, at in enumerate(at_s.tolist()):
        if at - last >= apart_s:
            kept.append(k)
            last = at
    found = np.stack([kept[:-1], kept[1:]], axis=1) if len(kept) > 1 else np.empty((0, 2), np.int64)
    return np.asarray(found[at_s[found[:, 1]] - at_s[found[:, 0]] < _LONG_S], np.int64)


def motions_of(drive: DriveRecord, mount: NDArray[np.float64]) -> Motions:
    """How the scanner moved between scans, by the scans; mount (3,): where it is believed to sit, to guess from."""
    pairs = chain_of(drive.scan_s, _STEP_S)
    start, end = drive.scan_s[pairs[:, 0]], drive.scan_s[pairs[:, 1]]
    said = _between_poses(drive.motion_s, compose(drive.odometry, mount[None]), start, end)
    moving = np.flatnonzero((np.hypot(said[:, 0], said[:, 1]) > _STILL_M) | (np.abs(said[:, 2]) > _TURNING_RAD / 2))
    moving = moving[:: max(1, -(-moving.size // _PAIRS))]
    rows = []
    for k in moving.tolist():
        guesses = np.array([said[k], [*said[k, :2], 0.0], np.zeros(3)])
        pair = scan_pairs.best_of(drive.surfaces[pairs[k, 0]], drive.surfaces[pairs[k, 1]].points, guesses)
        if pair.share > _SHARE:
            rows.append((start[k], end[k], *pair.pose))
    found = np.array(rows, np.float64).reshape(-1, 5)
    return Motions(found[:, 0], found[:, 1], found[:, 2:])


def true_motions(drive: DriveRecord) -> Motions:
    """How the tracked body moved, by the truth of the log."""
    pairs = chain_of(drive.truth_s, _STEP_S)
    start, end = drive.truth_s[pairs[:, 0]], drive.truth_s[pairs[:, 1]]
    return Motions(start, end, between(drive.truth[pairs[:, 0]], drive.truth[pairs[:, 1]]))


def _between_poses(
    at_s: NDArray[np.float64], poses: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n, 3) steps of interpolated poses (k, 3)."""
    poses = poses.copy()
    poses[:, 2] = np.unwrap(poses[:, 2])
    first, last = (np.stack([np.interp(t, at_s, v) for v in poses.T], axis=1) for t in (start, end))
    return np.asarray(between(first, last))


def rolled_by(odometry: NDArray[np.float64], track_m: float) -> NDArray[np.float64]:
    """(k, 2) how far two wheels would have rolled (m) to make the odometry (k, 3)."""
    steps = between(odometry[:-1], odometry[1:])
    ahead = steps[:, 0] * np.cos(steps[:, 2] / 2) + steps[:, 1] * np.sin(steps[:, 2] / 2)
    turn = steps[:, 2] * track_m / 2
    both = np.cumsum(np.stack([ahead - turn, ahead + turn], axis=1), axis=0)
    return np.concatenate([np.zeros((1, 2)), both])
