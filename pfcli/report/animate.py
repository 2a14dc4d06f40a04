"""The filter at work as a film: particles gathering on the map, as in the papers' figures."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from pfcli.errors import UsageError
from pfcli.outputs import check_file, output_file
from pfcli.report.plots import agg, draw_map
from pfcli.systems.result import Result

KINDS = (".gif", ".mp4")
_FRAMES, _PER_S = 150, 12
_COLOURS = "tab10"


def check(film: Path) -> None:
    """Refuse a film early that could not be made: another ending, no ffmpeg for .mp4, a place that cannot be written."""
    if film.suffix not in KINDS:
        raise UsageError(f"--animate {film}: the ending must be one of {', '.join(KINDS)}")
    if film.suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise UsageError(f"--animate {film}: ffmpeg, which writes .mp4, is not installed; name a .gif")
    check_file(film, force=True)


def animate(film: Path, result: Result, title: str) -> None:
    """Draw at most 150 evenly spaced updates: map, track so far, particles by class, scan and estimate."""
    pyplot = agg()
    from matplotlib import animation

    frames = result.frames[:: -(-len(result.frames) // _FRAMES) or 1]
    figure, axes = pyplot.subplots(figsize=(7, 6), layout="constrained")
    if result.grid is not None:
        draw_map(axes, result.grid)
    poses, stamps = result.track.poses, result.track.stamps_ns
    known = poses[np.isfinite(poses).all(axis=1)]
    if result.grid is None:
        axes.set_xlim(known[:, 0].min() - 5, known[:, 0].max() + 5)
        axes.set_ylim(known[:, 1].min() - 5, known[:, 1].max() + 5)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    way = axes.plot([], [], color="tab:red", linewidth=0.9)[0]
    cloud = axes.scatter([], [], s=3, c=[], cmap=_COLOURS, vmin=0, vmax=9)
    scan = axes.plot([], [], ".", color="tab:cyan", markersize=2)[0]
    robot = axes.plot([], [], "o", color="tab:red", markersize=5)[0]

    def show(k: int) -> list[Any]:
        frame = frames[k]
        so_far = stamps <= frame.stamp_ns
        way.set_data(poses[so_far, 0], poses[so_far, 1])
        cloud.set_offsets(frame.particles[:, :2] if len(frame.particles) else np.empty((0, 2)))
        cloud.set_array(frame.labels.astype(float) % 10)
        x, y, yaw = frame.pose
        c, s = np.cos(yaw), np.sin(yaw)
        ends = frame.scan_m.reshape(-1, 2) @ np.array([[c, s], [-s, c]]) + [x, y]
        scan.set_data(ends[:, 0], ends[:, 1])
        robot.set_data([x], [y])
        axes.set_title(f"{title}, {(frame.stamp_ns - stamps[0]) * 1e-9:.1f} s")
        return [way, cloud, scan, robot]

    writer = animation.PillowWriter(_PER_S) if film.suffix == ".gif" else animation.FFMpegWriter(_PER_S)
    try:
        with output_file(film) as partial:
            made = animation.FuncAnimation(figure, show, frames=len(frames))
            made.save(partial, writer=writer, dpi=90)
    finally:
        pyplot.close(figure)
