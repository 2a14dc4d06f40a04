"""A track against true poses: ATE, RPE, NEES. Agreement with evo is a test."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pfcli.core.evaluation.se2 import between, compose, wrap
from pfcli.errors import LogError
from pfcli.events import stamp_text

_Array = NDArray[np.float64]


def associate(
    stamps: NDArray[np.int64], reference: NDArray[np.int64], max_gap_ns: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs (index into stamps, index into reference) nearest in time, each at most `max_gap_ns` apart."""
    order = np.argsort(reference, kind="stable")
    at = np.clip(np.searchsorted(reference[order], stamps), 1, reference.size - 1) if reference.size > 1 else None
    if at is None:
        nearest = np.zeros(stamps.size, np.int64)
    else:
        before, after = order[at - 1], order[at]
        nearest = np.where(stamps - reference[before] <= reference[after] - stamps, before, after)
    close = np.abs(stamps - reference[nearest]) <= max_gap_ns
    if not close.any():
        a, b = (f"{stamp_text(int(s.min()))} .. {stamp_text(int(s.max()))}" for s in (stamps, reference))
        raise LogError(f"no stamp of the track is near one of the truth: the track spans {a}, the truth {b}")
    return np.flatnonzero(close), nearest[close]


def align_se2(poses: _Array, truth: _Array) -> _Array:
    """Pose (3,) that moves `poses` onto `truth` with the least squared distance (Umeyama 1991 without scale)."""
    a, b = poses[:, :2], truth[:, :2]
    ma, mb = a.mean(axis=0), b.mean(axis=0)
    x, y = a - ma, b - mb
    angle = np.arctan2((x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]).sum(), (x * y).sum())
    c, s = np.cos(angle), np.sin(angle)
    return np.array([mb[0] - c * ma[0] + s * ma[1], mb[1] - s * ma[0] - c * ma[1], angle])


class Aligner(Protocol):
    """Pose that moves a track onto its truth."""

    def __call__(self, poses: _Array, truth: _Array) -> _Array:
        """Poses and truth are (n, 3) rows of the same instants."""
        ...


class Errors(NamedTuple):
    """Against truth, per pose of the track (NaN where truth has none): position (m), heading (rad, signed), the offset of the
    position (n, 2) in the track's own frame (m), and the NEES of the position, where the track's covariance is known."""

    position_m: _Array
    yaw_rad: _Array
    offset_m: _Array
    nees: _Array | None = None

    def normalised(self, columns: Mapping[str, Any]) -> _Array | None:
        """Normalised squared errors of the positions (n,), 2 on average where the covariance is right (Bar-Shalom 2001, 5.4);
        None where the track has no covariance. columns: of the track."""
        names = ("cov_xx_m2", "cov_xy_m2", "cov_yy_m2")
        if not set(names) <= set(columns):
            return None
        xx, xy, yy = (np.asarray(columns[name], float) for name in names)
        x, y = self.offset_m.T
        det = xx * yy - xy * xy
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.where(det > 1e-18, (yy * x * x - 2 * xy * x * y + xx * y * y) / det, np.nan))

    def summary(self) -> dict[str, Any]:
        """ATE (RMSE), mean, median and maximum; the heading's RMSE (None: truth has none); the mean NEES where it is known."""
        p, a = (v[np.isfinite(v)] for v in (self.position_m, self.yaw_rad))
        n = self.nees[np.isfinite(self.nees)] if self.nees is not None else np.empty(0)
        nees = {"nees_mean": round(float(n.mean()), 4)} if n.size else {}
        return {
            "poses": int(p.size),
            "ate_m": round(float(np.sqrt((p**2).mean())), 6),
            "mean_m": round(float(p.mean()), 6),
            "median_m": round(float(np.median(p)), 6),
            "max_m": round(float(p.max()), 6),
            "heading_rmse_deg": round(float(np.degrees(np.sqrt((a**2).mean()))), 6) if a.size else None,
            **nees,
        }


def interpolate(stamps: NDArray[np.int64], reference: NDArray[np.int64], poses: _Array) -> _Array:
    """Poses at `stamps`, linear between the reference's (n, 3); NaN outside its span or across gaps over 1 s."""
    order = np.argsort(reference, kind="stable")
    t, p = reference[order], poses[order]
    at = np.clip(np.searchsorted(t, stamps), 1, max(1, t.size - 1))
    if t.size < 2:
        return np.where((stamps == t[0])[:, None], p[0], np.nan)
    a, b = at - 1, at
    gap = np.maximum(t[b] - t[a], 1)
    share = (stamps - t[a]) / gap
    out: _Array = p[a] + share[:, None] * (p[b] - p[a])
    out[:, 2] = wrap(p[a, 2] + share * wrap(p[b, 2] - p[a, 2]))
    outside = (stamps < t[a]) | (stamps > t[b]) | ((gap > 1_000_000_000) & (share > 0) & (share < 1))
    out[outside] = np.nan
    return out


def errors_against(
    stamps: NDArray[np.int64], poses: _Array, truth_stamps: NDArray[np.int64], truth: _Array, aligner: Aligner | None
) -> Errors:
    """Errors of every pose against the truth interpolated to its stamp, after alignment (None: frames are the same)."""
    there = interpolate(stamps, truth_stamps, truth)
    known = np.isfinite(there[:, 0])
    if not known.any():
        associate(stamps, truth_stamps, 0)
    return errors_of(poses, there, aligner(poses[known], there[known]) if aligner else None)


def errors_of(poses: _Array, truth: _Array, by: _Array | None) -> Errors:
    """Errors of poses (n, 3) that `by` (3,) moves into the frame of the truth (n, 3) (None: frames are the same)."""
    moved = poses if by is None else compose(by[None], poses)
    off = (moved - truth)[:, :2]
    c, s = (1.0, 0.0) if by is None else (np.cos(by[2]), np.sin(by[2]))
    return Errors(np.hypot(*off.T), wrap(moved[:, 2] - truth[:, 2]), off @ np.array([[c, -s], [s, c]]))


def relative_errors(poses: _Array, truth: _Array, delta: int = 1) -> tuple[_Array, _Array]:
    """RPE over `delta` poses: translation (m) and |rotation| (rad) of inv(truth step) o (track step)."""
    step: _Array = between(between(truth[:-delta], truth[delta:]), between(poses[:-delta], poses[delta:]))
    return np.hypot(step[:, 0], step[:, 1]), np.abs(step[:, 2])
