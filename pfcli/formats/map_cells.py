"""From the pixels of a map's image to its cells, as nav2_map_server reads them (its map_io.cpp, `loadMapFromFile`).

The brightness of a pixel is the mean of its channels; with alpha in mode trinary alpha is one of them. Occupancy is what is
left of 1, or the brightness itself where `negate` is set. Grades between free and occupied, which modes scale and raw know,
become free where that is likelier, else unknown: the systems know three kinds of cell.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

MODES = ("trinary", "scale", "raw")
_LIKELY = 50


class Rule(NamedTuple):
    """mode: one of `MODES`; free, occupied: thresholds of the occupancy, 0 .. 1; negate: white is occupied; unknown_grey: a
    shade of 8 bits that is unknown whatever the thresholds say (-1: none)."""

    mode: str = "trinary"
    free: float = 0.196
    occupied: float = 0.65
    negate: bool = False
    unknown_grey: int = -1


def cells_of(image: Image.Image, rule: Rule) -> NDArray[np.int8]:
    """Cells (rows, cols) of an image, from its top: 0 free, 1 occupied, -1 unknown."""
    shades, alpha = _shades(image)
    if alpha is None and shades.dtype == np.uint8:
        every = np.arange(256) / 255.0
        return np.asarray(_cells(every, None, rule)[shades])
    bright = (shades if shades.ndim == 2 else shades.mean(axis=2)) / (65535.0 if shades.dtype == np.uint16 else 255.0)
    return _cells(bright, None if alpha is None else alpha / 255.0, rule)


def grey_share(image: Image.Image, grey: int) -> float:
    """Share of the pixels that have this shade of 8 bits."""
    shades, _ = _shades(image)
    if shades.ndim == 3:
        shades = shades.mean(axis=2)
    return float((np.rint(shades / (257.0 if shades.dtype == np.uint16 else 1.0)) == grey).mean())


def grades(bright: NDArray[np.float64], alpha: NDArray[np.float64] | None, rule: Rule) -> NDArray[np.int64]:
    """Occupancy 0 .. 100 of brightness (0 .. 1), as nav2_map_server publishes it; -1 unknown. alpha: 1 is opaque."""
    if rule.mode == "raw":
        percent = np.floor(bright * 255.0 + 0.5)
        return np.where(percent <= 100, percent, -1).astype(np.int64)
    if rule.mode == "trinary" and alpha is not None:
        bright = (3.0 * bright + alpha) / 4.0
    taken = bright if rule.negate else 1.0 - bright
    between = np.full(taken.shape, -1.0)
    if rule.mode == "scale":
        between = np.rint((taken - rule.free) / (rule.occupied - rule.free) * 100.0)
    found = np.where(taken > rule.occupied, 100, np.where(taken < rule.free, 0, between))
    if rule.mode == "scale" and alpha is not None:
        found = np.where(alpha < 1.0, -1, found)
    return found.astype(np.int64)


def _cells(bright: NDArray[np.float64], alpha: NDArray[np.float64] | None, rule: Rule) -> NDArray[np.int8]:
    found = grades(bright, alpha, rule)
    high = rule.occupied * 100.0 if rule.mode == "raw" else 99.5
    cells = np.where(found < 0, -1, np.where(found > high, 1, np.where(found < _LIKELY, 0, -1)))
    if rule.unknown_grey >= 0:
        cells = np.where(np.rint(bright * 255.0) == rule.unknown_grey, -1, cells)
    return cells.astype(np.int8)


def _shades(image: Image.Image) -> tuple[NDArray[Any], NDArray[np.uint8] | None]:
    """Grey (rows, cols) or colours (rows, cols, 3) in the depth of the file, and alpha (rows, cols) where it has any."""
    if image.mode in ("I", "I;16", "I;16L", "I;16B", "I;16N"):
        return np.clip(np.asarray(image), 0, 65535).astype(np.uint16), None
    if image.mode in ("LA", "PA", "RGBA", "La", "RGBa") or "transparency" in image.info:
        both = np.asarray(image.convert("RGBA"))
        return both[..., :3], both[..., 3]
    if image.mode in ("1", "L"):
        return np.asarray(image.convert("L")), None
    colours = np.asarray(image.convert("RGB"))
    grey = (colours[..., 0] == colours[..., 1]).all() and (colours[..., 0] == colours[..., 2]).all()
    return (np.ascontiguousarray(colours[..., 0]) if grey else colours), None
