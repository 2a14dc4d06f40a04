"""What a run of localize-partial is worth beside its truth: classes, crossings, entries, poses."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.evaluation import se2, track_error
from pfcli.core.grid.region import places, region_of
from pfcli.formats import map_yaml, parquet
from pfcli.registry import filter_of, system
from pfcli.replay.log import Log
from pfcli.runs import loop

SETTLED_M = 10.0
RIGHT_M, RIGHT_RAD = 0.3, np.radians(10.0)


KNOWN_SD_M = 5.0
"""A pose outside counts as known while the filter says that it errs by less."""


class Drive(NamedTuple):
    """A run beside its truth, one row per update: way, P(in), true in, true class, most likely class, position error,
    heading error, time (s), and position error as known afterwards (NaN without --smooth); ms an
    update; what the filter says of its error (m)."""

    way: NDArray[np.float64]
    p_in: NDArray[np.float64]
    truly_in: NDArray[np.bool_]
    true_class: NDArray[np.int64]
    said_class: NDArray[np.int64]
    error: NDArray[np.float64]
    error_yaw: NDArray[np.float64]
    t_s: NDArray[np.float64]
    ms: float
    error_after: NDArray[np.float64]
    sd_m: NDArray[np.float64]


def true_classes(inside: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The six classes of table 1 along a drive: before and now in the map, and whether ever before."""
    found = np.empty(inside.size, np.int64)
    been = bool(inside[0])
    found[0] = 3 if inside[0] else 1
    for k in range(1, inside.size):
        was, now = inside[k - 1], inside[k]
        found[k] = (3 if now else 4) if was else ((6 if been else 2) if now else (5 if been else 1))
        been |= bool(now)
    return found


def truth_at(stamps: NDArray[np.int64], log: Path, map_file: Path) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """True poses at the stamps, and whether they lie in the map."""
    truth = list(Log(log).events(["truth"]))
    there = track_error.interpolate(stamps, np.array([e.stamp_ns for e in truth]), np.array([e[1:4] for e in truth]))
    grid = map_yaml.read(map_file)
    return there, places(region_of(grid.cells, grid.resolution_m, grid.origin), there[:, :2]) != 0


def beside_truth(done: loop.Run, log: Path, map_file: Path) -> Drive:
    """Compare every update with the truth."""
    rows = parquet.columns_of(done.infos, filter_of(system("localize-partial")).info)
    stamps = np.asarray(rows["t_ns"])
    there, inside = truth_at(stamps, log, map_file)
    index = np.searchsorted(done.result.track.stamps_ns, stamps)
    poses = done.result.track.poses[index]
    b = np.stack([np.asarray(rows[f"b{k}"]) for k in range(1, 7)], 1)
    track = done.result.track.columns
    return Drive(
        np.asarray(rows["way_m"]),
        track["in_map_smoothed"][index] if "in_map_smoothed" in track else np.asarray(rows["in_map"]),
        inside,
        true_classes(inside),
        1 + b.argmax(axis=1),
        np.hypot(*(poses - there)[:, :2].T),
        np.abs(se2.wrap(poses[:, 2] - there[:, 2])),
        (stamps - stamps[0]) * 1e-9,
        1e3 * done.seconds["loop"] / len(done.infos),
        np.hypot(*(_afterwards(done)[index] - there[:, :2]).T),
        np.asarray(rows["sd_m"]),
    )


def _afterwards(done: loop.Run) -> NDArray[np.float64]:
    """Positions (n, 2) as the whole log knows them."""
    track = done.result.track
    if "x_smoothed_m" not in track.columns:
        return np.full((track.stamps_ns.size, 2), np.nan)
    return np.stack([track.columns["x_smoothed_m"], track.columns["y_smoothed_m"]], axis=1)


class Score(NamedTuple):
    """Of one drive: right in/out, Brier score, delays of crossings (m; inf where not noticed), right poses after entries
    within 8 m, false entries, seconds outside, errors inside once converged (m, rad), errors outside (m), the same afterwards."""

    right: float
    brier: float
    delays: list[float]
    entered: list[bool]
    false_entries: int
    outside_s: float
    errors: NDArray[np.float64]
    errors_yaw: NDArray[np.float64]
    outside: NDArray[np.float64]
    outside_after: NDArray[np.float64]


def judge(d: Drive) -> Score:
    """Score a drive."""
    late = d.way >= SETTLED_M
    right = float(((d.p_in >= 0.5) == d.truly_in)[late].mean()) if late.any() else np.nan
    brier = float(((d.p_in - d.truly_in) ** 2)[late].mean()) if late.any() else np.nan
    said = d.p_in >= 0.5
    delays, entered = [], []
    flips = np.flatnonzero(d.truly_in[1:] != d.truly_in[:-1]) + 1
    for k, at in enumerate(flips.tolist()):
        end = flips[k + 1] if k + 1 < flips.size else d.way.size
        if d.way[end - 1] - d.way[at] < 1.0:
            continue  # back again before anybody could notice
        agree = np.flatnonzero(said[at:end] == d.truly_in[at])
        delays.append(float(d.way[at + agree[0]] - d.way[at]) if agree.size else np.inf)
        if d.truly_in[at]:
            good = said & (d.error < RIGHT_M) & (d.error_yaw < RIGHT_RAD)
            soon = d.way[at:end] - d.way[at] <= 8.0
            entered.append(bool(good[at:end][soon].any()))
    wrong = said & ~d.truly_in & late
    near = np.zeros(said.size, bool)  # within 3 m of a true crossing it is early or late, not false
    for at in flips:
        near |= np.abs(d.way - d.way[at]) < 3.0
    starts = np.flatnonzero((wrong & ~near)[1:] & ~(wrong & ~near)[:-1])
    dt = np.diff(d.t_s, prepend=d.t_s[0])
    settled = d.truly_in & said & np.isfinite(d.error)
    since = np.zeros(settled.size)  # way with a right pose: converged after 2 m of it
    run_m = 0.0
    for k in range(1, settled.size):
        run_m = run_m + d.way[k] - d.way[k - 1] if settled[k] and d.error[k] < 1.0 else 0.0
        since[k] = run_m
    inside = since > 2.0
    return Score(
        right,
        brier,
        delays,
        entered,
        starts.size,
        float(dt[~d.truly_in].sum()),
        d.error[inside],
        d.error_yaw[inside],
        np.where(d.sd_m <= KNOWN_SD_M, d.error, np.nan)[~d.truly_in],
        d.error_after[~d.truly_in],
    )


HEAD = (
    "\n| {} | in/out right | Brier | noticed after [m]: median, 90 % | entries with the right pose within 8 m |"
    " false entries |"
    " pose inside [m, deg] | pose outside [m]: then, afterwards | ms an update |\n|---|---|---|---|---|---|---|---|---|"
)


def row(name: str, scores: list[Score], ms: float) -> str:
    delays = np.array([v for s in scores for v in s.delays] or [np.nan])
    entered = [v for s in scores for v in s.entered]
    errors = np.concatenate([s.errors for s in scores])
    yaw = np.degrees(np.concatenate([s.errors_yaw for s in scores]))
    hours = sum(s.outside_s for s in scores) / 3600
    q = np.quantile(delays, [0.5, 0.9], method="higher")
    rmse = (np.sqrt(np.mean(errors**2)), np.sqrt(np.mean(yaw**2))) if errors.size else (np.nan, np.nan)
    return (
        f"| {name} | {np.nanmean([s.right for s in scores]):.3f} | {np.nanmean([s.brier for s in scores]):.3f} |"
        f" {q[0]:.2f}, {q[1]:.2f} ({delays.size}) | {sum(entered)}/{len(entered)} |"
        f" {sum(s.false_entries for s in scores)} in {hours:.2f} h | {rmse[0]:.3f}, {rmse[1]:.2f} |"
        f" {_known([s.outside for s in scores])}, {_known([s.outside_after for s in scores])} | {ms:.2f} |"
    )


def _known(errors: list[NDArray[np.float64]]) -> str:
    """RMSE of those that are known, and their share."""
    every = np.concatenate(errors)
    known = every[np.isfinite(every)]
    return f"{np.sqrt(np.mean(known**2)):.2f} ({known.size / every.size:.2f})" if known.size else "-"
