"""What pictures are made of: maps, landmarks, tracks (matplotlib, Agg)."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.grid_map import GridMap
from pfcli.formats.atomic import output_file

DPI = 110


def draw_tracks(path: Path, grid: GridMap | None, tracks: Mapping[str, NDArray[np.float64]]) -> None:
    """Several tracks (n, 3) by name over one map."""
    with _picture(path, "") as axes:
        if grid is not None:
            draw_map(axes, grid)
        for name, poses in tracks.items():
            axes.plot(poses[:, 0], poses[:, 1], linewidth=0.9, label=name)


@contextmanager
def _picture(path: Path, title: str) -> Iterator[Any]:
    """Axes in metres; the picture is written when the block ends."""
    with _figure() as (figure, axes):
        yield axes
        _label(axes, title)
        with output_file(path) as partial:
            figure.savefig(partial, dpi=DPI, metadata=metadata_of(path))


@contextmanager
def _figure() -> Iterator[tuple[Any, Any]]:
    """A figure and its axes, drawn without pyplot: the backend and the figures of a notebook stay as they are."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"svg.hashsalt": "pfcli"}):
        figure = Figure(figsize=(9, 8), layout="constrained")
        yield figure, figure.subplots()


def _label(axes: Any, title: str) -> None:
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title=title)
    axes.legend(loc="upper right")


def metadata_of(path: Path) -> dict[str, Any]:
    """What keeps the date out of a picture, by its ending."""
    found: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    return found.get(path.suffix, {})


def agg() -> Any:
    """matplotlib.pyplot that draws into files, with ids that repeat."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "pfcli"
    from matplotlib import pyplot

    return pyplot


def draw_landmarks(axes: Any, table: dict[str, Any]) -> None:
    """Landmarks with the ellipses of two standard deviations."""
    from matplotlib.patches import Ellipse

    rows = zip(*(table[name] for name in ("x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2")), strict=True)
    for x, y, xx, xy, yy in rows:
        values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
        width, height = 4.0 * np.sqrt(np.maximum(values, 0.0))
        angle = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
        axes.add_patch(Ellipse((x, y), width, height, angle=angle, fill=False, color="tab:gray", linewidth=0.8))
    axes.plot(table["x_m"], table["y_m"], "+", color="black", markersize=6, label="landmarks")


def draw_map(axes: Any, grid: GridMap) -> NDArray[np.float64]:
    """Occupied black, free white, unknown grey; turned as its origin is. Returns its corners (4, 2), m."""
    from matplotlib.transforms import Affine2D

    shades = np.full(grid.cells.shape, 0.8)
    shades[grid.cells == 0] = 1.0
    shades[grid.cells == 1] = 0.0
    rows, cols = grid.cells.shape
    box = (0.0, cols * grid.resolution_m, 0.0, rows * grid.resolution_m)
    turned = Affine2D().rotate(grid.origin.yaw_rad).translate(grid.origin.x_m, grid.origin.y_m)
    image = axes.imshow(shades, cmap="gray", vmin=0, vmax=1, origin="lower", extent=box, interpolation="nearest")
    image.set_transform(turned + axes.transData)
    corners = turned.transform([(x, y) for x in box[:2] for y in box[2:]])
    axes.set_xlim(corners[:, 0].min(), corners[:, 0].max())
    axes.set_ylim(corners[:, 1].min(), corners[:, 1].max())
    return np.asarray(corners)
