"""Pictures of a run (matplotlib, Agg)."""

from pathlib import Path
from typing import Any

import numpy as np

from pfcli.outputs import output_file
from pfcli.systems.result import Result


def draw(path: Path, result: Result, title: str) -> None:
    """Map with the track over it. The bytes depend on the result only (no date, fixed ids)."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "pfcli"
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9, 8), layout="constrained")
    if result.grid is not None:
        _map(axes, result)
    if "landmarks" in result.tables:
        _landmarks(axes, result.tables["landmarks"])
    poses = result.track.poses
    axes.plot(poses[:, 0], poses[:, 1], color="tab:red", linewidth=0.9, label="track")
    axes.plot(*poses[0, :2], "o", color="tab:green", markersize=5, label="start")
    axes.plot(*poses[-1, :2], "s", color="tab:blue", markersize=5, label="end")
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title=title)
    axes.legend(loc="upper right")
    metadata: dict[str, Any] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix, {})
    try:
        with output_file(path) as partial:
            figure.savefig(partial, dpi=110, metadata=metadata)
    finally:
        pyplot.close(figure)


def _landmarks(axes: Any, table: dict[str, Any]) -> None:
    """Landmarks with the ellipses of two standard deviations."""
    from matplotlib.patches import Ellipse

    rows = zip(*(table[name] for name in ("x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2")), strict=True)
    for x, y, xx, xy, yy in rows:
        values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
        width, height = 4.0 * np.sqrt(np.maximum(values, 0.0))
        angle = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
        axes.add_patch(Ellipse((x, y), width, height, angle=angle, fill=False, color="tab:gray", linewidth=0.8))
    axes.plot(table["x_m"], table["y_m"], "+", color="black", markersize=6, label="landmarks")


def _map(axes: Any, result: Result) -> None:
    grid = result.grid
    assert grid is not None
    shades = np.full(grid.cells.shape, 0.8)
    shades[grid.cells == 0] = 1.0
    shades[grid.cells == 1] = 0.0
    rows, cols = grid.cells.shape
    x, y = grid.origin.x_m, grid.origin.y_m
    box = (x, x + cols * grid.resolution_m, y, y + rows * grid.resolution_m)
    axes.imshow(shades, cmap="gray", vmin=0, vmax=1, origin="lower", extent=box, interpolation="nearest")
