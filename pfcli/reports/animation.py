"""The filter at work, as a film or as a sheet of instants: particles gathering on the map, as in the papers' figures."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from pfcli.errors import UsageError
from pfcli.formats.atomic import check_file, output_file
from pfcli.reports.plots import agg, draw_map, metadata_of
from pfcli.systems.shared.contract import Frame, Result

FILMS = (".gif", ".mp4")
SHEETS = (".png", ".svg", ".pdf")
_FRAMES, _PER_S = 150, 12
_ROWS, _COLUMNS = 2, 4
_COLOURS = "tab10"
_AROUND_M = 5.0
"""What the robot sees beside its way is in the picture."""


def check(film: Path) -> None:
    """Refuse a film early that could not be made: another ending, no ffmpeg for .mp4, a place that cannot be written."""
    if film.suffix not in FILMS + SHEETS:
        raise UsageError(f"--animate {film}: the ending must be one of {', '.join(FILMS + SHEETS)}")
    if film.suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise UsageError(f"--animate {film}: ffmpeg, which writes .mp4, is not installed; name a .gif")
    check_file(film, force=True)


def animate(film: Path, result: Result, title: str) -> None:
    """A film of at most 150 evenly spaced updates, or a sheet of eight: map, track so far, particles by class, scan, estimate."""
    (_film if film.suffix in FILMS else _sheet)(film, result, title)


class _View:
    """One picture of the filter."""

    def __init__(self, axes: Any, result: Result) -> None:
        self._axes, self._track = axes, result.track
        poses = result.track.poses
        known = poses[np.isfinite(poses).all(axis=1), :2]
        shown = [known - _AROUND_M, known + _AROUND_M]
        if result.grid is not None:
            shown.append(draw_map(axes, result.grid))
        low, high = np.concatenate(shown).min(axis=0), np.concatenate(shown).max(axis=0)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_facecolor("0.8")  # unknown, as the map has it
        axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
        self._way = axes.plot([], [], color="tab:red", linewidth=0.9)[0]
        self._cloud = axes.scatter([], [], s=3, c=[], cmap=_COLOURS, vmin=0, vmax=9, zorder=3)
        self._scan = axes.plot([], [], ".", color="tab:cyan", markersize=2)[0]
        self._robot = axes.plot([], [], "o", color="tab:red", markersize=5)[0]

    def show(self, frame: Frame, title: str) -> list[Any]:
        """Put a frame into it; returns what has changed."""
        stamps, poses = self._track.stamps_ns, self._track.poses
        so_far = stamps <= frame.stamp_ns
        self._way.set_data(poses[so_far, 0], poses[so_far, 1])
        self._cloud.set_offsets(frame.particles[:, :2] if len(frame.particles) else np.empty((0, 2)))
        self._cloud.set_array(frame.labels.astype(float) % 10)
        x, y, yaw = frame.pose
        c, s = np.cos(yaw), np.sin(yaw)
        ends = frame.scan_m.reshape(-1, 2) @ np.array([[c, s], [-s, c]]) + [x, y]
        self._scan.set_data(ends[:, 0], ends[:, 1])
        self._robot.set_data([x], [y])
        self._axes.set_title(f"{title}{(frame.stamp_ns - stamps[0]) * 1e-9:.1f} s")
        return [self._way, self._cloud, self._scan, self._robot]


def _film(film: Path, result: Result, title: str) -> None:
    pyplot = agg()
    from matplotlib import animation

    frames = result.frames[:: -(-len(result.frames) // _FRAMES) or 1]
    figure, axes = pyplot.subplots(figsize=(7, 6), layout="constrained")
    view = _View(axes, result)
    writer = animation.PillowWriter(_PER_S) if film.suffix == ".gif" else animation.FFMpegWriter(_PER_S)
    try:
        with output_file(film) as partial:
            made = animation.FuncAnimation(figure, lambda k: view.show(frames[k], f"{title}, "), frames=len(frames))
            made.save(partial, writer=writer, dpi=90)
    finally:
        pyplot.close(figure)


def _sheet(path: Path, result: Result, title: str) -> None:
    pyplot = agg()
    from matplotlib.lines import Line2D

    wanted = np.linspace(0, len(result.frames) - 1, _ROWS * _COLUMNS).round().astype(int)
    frames = [result.frames[k] for k in np.unique(wanted)]
    figure, grid = pyplot.subplots(
        _ROWS, _COLUMNS, figsize=(15, 8), sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    try:
        for axes, frame in zip(grid.ravel(), frames, strict=False):
            _View(axes, result).show(frame, "")
            axes.label_outer()
        for axes in grid.ravel()[len(frames) :]:
            axes.set_axis_off()
        figure.suptitle(title)
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        figure.set_figheight(1.5 + _ROWS * min(6.0, 0.6 + 15.0 / _COLUMNS * (high - low) / (right - left)))
        classes = np.unique(np.concatenate([frame.labels for frame in frames]))
        if classes.size > 1:
            colour = pyplot.get_cmap(_COLOURS)
            dots = [Line2D([], [], marker=".", linestyle="", color=colour(int(k) % 10)) for k in classes]
            figure.legend(dots, [f"class {k}" for k in classes], loc="outside lower center", ncols=classes.size)
        with output_file(path) as partial:
            figure.savefig(partial, dpi=90, metadata=metadata_of(path))
    finally:
        pyplot.close(figure)
