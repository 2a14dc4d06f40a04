"""How good a track or a map is: relations, ATE, RPE, doubled walls. Plain numpy; agreement with evo is a test."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pfcli.errors import LogError
from pfcli.events import Pose2
from pfcli.formats.map_yaml import GridMap
from pfcli.formats.relations import Relation
from pfcli.formats.tum import stamp_text

FAR_SCANS = 100
"""Relations of scans at least so far apart are re-visits; they judge a SLAM, the short ones are met by odometry."""

_Array = NDArray[np.float64]


def wrap(angle: _Array) -> _Array:
    """Angles in -pi .. pi."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def compose(a: _Array, b: _Array) -> _Array:
    """Pose rows b (.., 3) in the frames of a (.., 3)."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x, y = b[..., 0], b[..., 1]
    return np.stack([a[..., 0] + c * x - s * y, a[..., 1] + s * x + c * y, wrap(a[..., 2] + b[..., 2])], -1)


def between(a: _Array, b: _Array) -> _Array:
    """Pose rows b seen from a."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return np.stack([c * dx + s * dy, -s * dx + c * dy, wrap(b[..., 2] - a[..., 2])], -1)


class Spread(NamedTuple):
    """Mean, standard deviation, 95 % quantile and maximum of n errors, and a 95 % block bootstrap interval of the mean."""

    n: int
    mean: float
    sd: float
    q95: float
    max: float
    low: float
    high: float


def spread(errors: _Array, seed: int = 0) -> Spread:
    """Statistics of errors that stand in order of time; the bootstrap draws blocks, since neighbours err alike."""
    if errors.size == 0:
        return Spread(0, *[float("nan")] * 6)
    low, high = block_bootstrap(errors, seed)
    return Spread(
        errors.size,
        float(errors.mean()),
        float(errors.std()),
        float(np.quantile(errors, 0.95)),
        float(errors.max()),
        low,
        high,
    )


def block_bootstrap(errors: _Array, seed: int = 0, rounds: int = 1000) -> tuple[float, float]:
    """95 % interval of the mean by the circular block bootstrap (Politis and Romano 1992), block length n^(1/2)."""
    n = errors.size
    block = max(1, round(n**0.5))
    rng = np.random.default_rng(seed)
    starts = rng.integers(0, n, (rounds, -(-n // block)))
    picks = (starts[:, :, None] + np.arange(block)).reshape(rounds, -1)[:, :n] % n
    low, high = np.quantile(errors[picks].mean(axis=1), [0.025, 0.975])
    return float(low), float(high)


class RelationErrors(NamedTuple):
    """Per relation: translation (m), |rotation| (rad), and how many scans lie between its two."""

    translation_m: _Array
    rotation_rad: _Array
    scans_apart: NDArray[np.int64]
    missing: int


def relation_errors(relations: list[Relation], stamps: list[str], poses: _Array) -> RelationErrors:
    """inv(rel) o (inv(x_i) o x_j); stamps: text of each pose, the relations' keys. Exact text first, then within 1 ms."""
    exact = {text: k for k, text in enumerate(stamps)}
    values = np.array([_number(t) for t in stamps])
    order = np.argsort(values, kind="stable")
    pairs, wanted = [], []
    for r in relations:
        i, j = (_find(key, exact, values, order) for key in (r.first, r.second))
        if i is not None and j is not None:
            pairs.append((i, j))
            wanted.append((r.x_m, r.y_m, r.yaw_rad))
    if not pairs:
        raise LogError(
            f"no relation fits: they run from {relations[0].first}, the track's stamps from {stamps[0]} to {stamps[-1]};"
            " give the log with --stamps"
        )
    index = np.array(pairs)
    error = between(np.array(wanted), between(poses[index[:, 0]], poses[index[:, 1]]))
    return RelationErrors(
        np.hypot(error[:, 0], error[:, 1]),
        np.abs(error[:, 2]),
        np.abs(index[:, 0] - index[:, 1]),
        len(relations) - len(pairs),
    )


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _find(key: str, exact: dict[str, int], values: _Array, order: NDArray[np.int64]) -> int | None:
    if key in exact:
        return exact[key]
    at = int(np.searchsorted(values[order], float(key)))
    near = [int(order[k]) for k in (at - 1, at) if 0 <= k < order.size]
    best = min(near, key=lambda k: abs(values[k] - float(key)))
    return best if abs(values[best] - float(key)) <= 1.5e-3 else None


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
        """ATE (RMSE), mean, median and maximum; the mean NEES where it is known."""
        p, a = (v[np.isfinite(v)] for v in (self.position_m, self.yaw_rad))
        n = self.nees[np.isfinite(self.nees)] if self.nees is not None else np.empty(0)
        nees = {"nees_mean": round(float(n.mean()), 4)} if n.size else {}
        return {
            "poses": int(p.size),
            "ate_m": round(float(np.sqrt((p**2).mean())), 6),
            "mean_m": round(float(p.mean()), 6),
            "median_m": round(float(np.median(p)), 6),
            "max_m": round(float(p.max()), 6),
            "heading_rmse_deg": round(float(np.degrees(np.sqrt((a**2).mean()))), 6),
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


def doubled_walls(grid: GridMap, reach_m: float = 0.2) -> float:
    """Cells that a morphological closing of radius `reach_m` adds, per free cell that borders a wall.

    A wall drawn twice leaves a narrow gap, which the closing fills; a wall drawn once leaves none. Corners and clutter
    add a little to any map, so the score compares maps of one place, or a map with the true one. The border measures
    the length of the walls whatever their thickness: per occupied cell, blurred walls would score better than thin ones.
    """
    occupied = grid.cells == 1
    if not occupied.any():
        return 0.0
    r = max(1, round(reach_m / grid.resolution_m))
    y, x = np.ogrid[-r : r + 1, -r : r + 1]
    padded = np.pad(occupied, 2 * r)
    closed = ndimage.binary_closing(padded, x * x + y * y <= r * r)
    border = ndimage.binary_dilation(occupied) & (grid.cells == 0)
    return float((closed & ~padded).sum() / max(1, border.sum()))


class MapAgreement(NamedTuple):
    """Intersection over union of occupied cells (each met within one cell), and the pose that was used."""

    iou: float
    moved: Pose2


def map_iou(grid: GridMap, truth: GridMap, moved: Pose2) -> MapAgreement:
    """Intersection over union of the occupied cells of two maps, +- 1 cell, `grid` moved by `moved` into truth's frame.

    Only true surfaces that `grid` has seen (within one cell) count: an unexplored room is not an error.
    """
    rows, cols = np.nonzero(grid.cells == 1)
    res = grid.resolution_m
    local = np.stack(
        [grid.origin.x_m + (cols + 0.5) * res, grid.origin.y_m + (rows + 0.5) * res, np.zeros(rows.size)], 1
    )
    world = compose(np.array([moved]), local)
    gx = np.floor((world[:, 0] - truth.origin.x_m) / truth.resolution_m).astype(int)
    gy = np.floor((world[:, 1] - truth.origin.y_m) / truth.resolution_m).astype(int)
    inside = (gx >= 0) & (gy >= 0) & (gx < truth.cells.shape[1]) & (gy < truth.cells.shape[0])
    drawn = np.zeros(truth.cells.shape, bool)
    drawn[gy[inside], gx[inside]] = True
    seen = _seen(grid, truth, moved)
    real = (truth.cells == 1) & seen
    near = np.ones((3, 3), bool)
    drawn_near, real_near = ndimage.binary_dilation(drawn, near), ndimage.binary_dilation(truth.cells == 1, near)
    hits = (real & drawn_near).sum()
    union = real.sum() + (drawn & ~real_near).sum() + (~inside).sum()
    return MapAgreement(float(hits / max(1, union)), moved)


def _seen(grid: GridMap, truth: GridMap, moved: Pose2) -> NDArray[np.bool_]:
    """True cells that the moved grid knows."""
    rows, cols = np.indices(truth.cells.shape)
    x = truth.origin.x_m + (cols.ravel() + 0.5) * truth.resolution_m
    y = truth.origin.y_m + (rows.ravel() + 0.5) * truth.resolution_m
    back = between(np.array([moved]), np.stack([x, y, np.zeros(x.size)], 1))
    gx = np.floor((back[:, 0] - grid.origin.x_m) / grid.resolution_m).astype(int)
    gy = np.floor((back[:, 1] - grid.origin.y_m) / grid.resolution_m).astype(int)
    ok = (gx >= 0) & (gy >= 0) & (gx < grid.cells.shape[1]) & (gy < grid.cells.shape[0])
    known = np.zeros(x.size, bool)
    known[ok] = grid.cells[gy[ok], gx[ok]] >= 0
    return known.reshape(truth.cells.shape)
