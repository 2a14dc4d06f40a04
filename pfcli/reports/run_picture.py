"""The picture of a run: its map, the track coloured by how sure the system is, truth and raw odometry beside it."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.evaluation.se2 import between, compose
from pfcli.formats.atomic import output_file
from pfcli.reports.plots import DPI, draw_landmarks, draw_map, metadata_of
from pfcli.runs.loop import Job, Run

_LONGEST_IN, _LEAST_IN, _LEGEND_IN = 9.0, 3.5, 0.9
"""Sides of a picture (inches), and what the legend below it takes."""
_MARGIN_M = 1.0
_JUMP_M = 0.5
"""A pose that moves so much farther than the odometry was not driven there: no line is drawn."""
_TRUTH, _ODOMETRY = "tab:green", "0.55"


class Drawn(NamedTuple):
    """What is drawn, in the frame of the track (m): poses (n, 3), NaN where they are not known; how sure the system is of each
    (n,), None where it does not say; what that is called; true places (n, 2); raw odometry (n, 3) from the first known pose."""

    title: str
    poses: NDArray[np.float64]
    confidence: NDArray[np.float64] | None
    confidence_name: str
    truth: NDArray[np.float64] | None
    odometry: NDArray[np.float64] | None
    jumps: NDArray[np.bool_]


def write(path: Path, job: Job, run: Run) -> None:
    """A PNG, SVG or PDF. The bytes depend on the run only (no date, fixed ids)."""
    with _figure(job, run) as figure, output_file(path) as partial:
        figure.savefig(partial, dpi=DPI, metadata=metadata_of(path))


def png(job: Job, run: Run) -> bytes:
    """The same picture as the bytes of a PNG."""
    out = BytesIO()
    with _figure(job, run) as figure:
        figure.savefig(out, format="png", dpi=DPI)
    return out.getvalue()


def drawn(job: Job, run: Run) -> Drawn:
    """What the picture of a run shows."""
    track, name = run.result.track, job.system.confidence
    poses = track.poses
    known = np.isfinite(poses).all(axis=1)
    odometry = None
    if run.odometry is not None and known.any():
        stamps, rows = run.odometry
        rows = rows[np.searchsorted(stamps, track.stamps_ns)]
        first = int(np.argmax(known))
        odometry = compose(poses[first], between(rows[first], rows))
    truth = None if run.errors is None else poses[:, :2] - run.errors.offset_m
    step = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    driven = np.zeros(step.size) if odometry is None else np.hypot(*np.diff(odometry[:, :2], axis=0).T)
    return Drawn(
        title=f"{job.system.name}: {', '.join(path.name for path in job.paths)}",
        poses=poses,
        confidence=np.asarray(track.columns[name], float) if name in track.columns else None,
        confidence_name=name,
        truth=truth,
        odometry=odometry,
        jumps=~(step <= driven + _JUMP_M),
    )


@contextmanager
def _figure(job: Job, run: Run) -> Iterator[Any]:
    """The picture as a figure, without pyplot: the backend and the figures of a notebook stay as they are."""
    import matplotlib
    from matplotlib.figure import Figure

    shown = drawn(job, run)
    low, high = _limits(run, shown)
    width, height = np.maximum((high - low) * (_LONGEST_IN / (high - low).max()), _LEAST_IN)
    with matplotlib.rc_context({"svg.hashsalt": "pfcli"}):
        figure = Figure(figsize=(width, height + _LEGEND_IN), layout="constrained")
        axes = figure.subplots()
        axes.set_facecolor("0.8")  # unknown, as the map has it
        if run.result.grid is not None:
            draw_map(axes, run.result.grid)
        if "landmarks" in run.result.tables:
            draw_landmarks(axes, run.result.tables["landmarks"])
        _lines(axes, figure, shown)
        axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), title=shown.title)
        axes.set(xticks=[], yticks=[])
        _scale_bar(axes, low, high)
        figure.legend(loc="outside lower center", ncols=4, frameon=False)
        yield figure


def _limits(run: Run, shown: Drawn) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of what is worth seeing: the track and the known part of the map, with a margin."""
    points = [shown.poses[np.isfinite(shown.poses).all(axis=1), :2]]
    if shown.truth is not None:
        points.append(shown.truth[np.isfinite(shown.truth).all(axis=1)])
    grid = run.result.grid
    if grid is not None and (grid.cells >= 0).any():
        rows, cols = (np.flatnonzero((grid.cells >= 0).any(axis=axis)) for axis in (1, 0))
        box = [(x, y, 0.0) for x in (cols[0], cols[-1] + 1) for y in (rows[0], rows[-1] + 1)]
        points.append(compose(np.array(grid.origin), np.array(box, float) * grid.resolution_m)[:, :2])
    every = np.concatenate(points)
    return every.min(axis=0) - _MARGIN_M, every.max(axis=0) + _MARGIN_M


def _lines(axes: Any, figure: Any, shown: Drawn) -> None:
    from matplotlib.collections import LineCollection

    poses = shown.poses
    if shown.odometry is not None:
        axes.plot(*shown.odometry[:, :2].T, color=_ODOMETRY, linewidth=0.8, linestyle=":", label="raw odometry")
    if shown.truth is not None:
        axes.plot(*shown.truth.T, color=_TRUTH, linewidth=2.2, alpha=0.5, label="truth")
    pieces: Any = np.stack([poses[:-1, :2], poses[1:, :2]], axis=1)[~shown.jumps]
    if shown.confidence is None:
        axes.add_collection(LineCollection(pieces, colors="tab:red", linewidths=1.0, label="track"))
    else:
        lines = LineCollection(pieces, cmap="RdYlBu", linewidths=1.4, label="track")
        lines.set_array(shown.confidence[1:][~shown.jumps])
        lines.set_clim(0.0, 1.0)
        axes.add_collection(lines)
        figure.colorbar(lines, ax=axes, shrink=0.6, pad=0.01, label=shown.confidence_name)
    known = np.flatnonzero(np.isfinite(poses).all(axis=1))
    if known.size:
        axes.plot(*poses[known[0], :2], "o", color="black", markersize=5, label="first known pose")
        axes.plot(*poses[known[-1], :2], "s", color="tab:blue", markersize=5, label="end")
    lost = poses.shape[0] - known.size
    if lost:
        axes.plot([], [], " ", label=f"{lost} of {poses.shape[0]} poses not known")
    if shown.jumps[known[1:] - 1].any() if known.size > 1 else False:
        axes.plot([], [], " ", label=f"{int(shown.jumps[known[1:] - 1].sum())} jumps, not drawn")


def _scale_bar(axes: Any, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
    """A bar of 1, 2 or 5 times a power of ten metres, about a fifth of the width."""
    fifth = float(high[0] - low[0]) / 5
    power = 10.0 ** np.floor(np.log10(fifth))
    length = max(k * power for k in (1, 2, 5) if k * power <= fifth)
    x, y = low[0] + 0.03 * (high[0] - low[0]), low[1] + 0.03 * (high[1] - low[1])
    axes.plot([x, x + length], [y, y], color="black", linewidth=3, solid_capstyle="butt")
    axes.annotate(
        f"{length:g} m", (x + length / 2, y), xytext=(0, 4), textcoords="offset points", ha="center", fontsize=9
    )
