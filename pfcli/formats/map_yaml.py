"""Occupancy maps as nav2_map_server keeps them: an image and a YAML file beside it."""

import hashlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from PIL import Image

from pfcli.core.grid.grid_map import GridMap
from pfcli.errors import LogError, printable, reason
from pfcli.events import Pose2
from pfcli.formats import map_cells, text_files
from pfcli.formats.limits import DEFAULTS
from pfcli.formats.map_cells import Rule

_T = TypeVar("_T")
FREE, UNKNOWN, OCCUPIED = 254, 205, 0
Image.MAX_IMAGE_PIXELS = None  # the limit here is an error with a name instead of a warning


def write(folder: Path, grid: GridMap, name: str = "map") -> None:
    """Write `name.pgm` and `name.yaml` (trinary, thresholds 0.65 and 0.196, full precision)."""
    shades = np.full(grid.cells.shape, UNKNOWN, np.uint8)
    shades[grid.cells == 0] = FREE
    shades[grid.cells == 1] = OCCUPIED
    rows, cols = grid.cells.shape
    (folder / f"{name}.pgm").write_bytes(b"P5\n%d %d\n255\n" % (cols, rows) + shades[::-1].tobytes())
    x, y, yaw = (float(v) for v in grid.origin)
    (folder / f"{name}.yaml").write_text(
        f"image: {name}.pgm\nmode: trinary\nresolution: {float(grid.resolution_m)!r}\norigin: [{x!r}, {y!r}, {yaw!r}]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def digest(grid: GridMap) -> str:
    """SHA-256 (hex) of what a map says: its cells, resolution and origin, whatever its files are called."""
    found = hashlib.sha256(np.ascontiguousarray(grid.cells).tobytes())
    found.update(repr((grid.cells.shape, float(grid.resolution_m), tuple(map(float, grid.origin)))).encode())
    return found.hexdigest()


def read(path: Path, max_mpx: float = DEFAULTS.map_mpx, unknown_grey: int = -1) -> GridMap:
    """Read a map by its YAML file as nav2_map_server does, see `pfcli.formats.map_cells`. Raises LogError, also where the image
    has more than `max_mpx` million pixels. unknown_grey: a shade that is unknown whatever the thresholds say."""
    header = _header(path)
    resolution = _number(path, header, "resolution", low=1e-4)
    origin = header.get("origin", [0, 0, 0])
    if not isinstance(origin, list) or len(origin) < 2 or not all(_finite(v) for v in origin[:3]):
        raise LogError(f"{path}: origin must be [x, y, yaw]")
    rule = _rule(path, header)._replace(unknown_grey=unknown_grey)
    cells = _of_image(path, header, max_mpx, lambda image: map_cells.cells_of(image, rule))
    yaw = float(origin[2]) if len(origin) > 2 else 0.0
    return GridMap(np.ascontiguousarray(cells[::-1]), resolution, Pose2(float(origin[0]), float(origin[1]), yaw))


def free_unknown(path: Path, max_mpx: float = DEFAULTS.map_mpx) -> tuple[float, float]:
    """Share of the pixels that have map_saver's grey of unknown cells, 205, where they count as free (else 0), and free_thresh.
    Raises LogError."""
    header = _header(path)
    rule = _rule(path, header)
    grade = int(map_cells.grades(np.array([UNKNOWN / 255.0]), None, rule)[0])
    if rule.mode == "raw" or rule.negate or not 0 <= grade < 50:
        return 0.0, rule.free
    return _of_image(path, header, max_mpx, lambda image: map_cells.grey_share(image, UNKNOWN)), rule.free


def _header(path: Path) -> dict[str, Any]:
    header = text_files.mapping(path, "map YAML")
    if header is None:
        raise LogError(f"{path}: is not map YAML (no `image:` in it)")
    return header


def _rule(path: Path, header: dict[str, Any]) -> Rule:
    """Thresholds, mode and negate in whatever type YAML has them."""
    free = _number(path, header, "free_thresh", 0.196)
    occupied = _number(path, header, "occupied_thresh", 0.65)
    if not 0 <= free < occupied <= 1:
        raise LogError(f"{path}: free_thresh {free:g} must lie below occupied_thresh {occupied:g}, both in 0 .. 1")
    mode = str(header.get("mode", "trinary")).lower()
    if mode not in map_cells.MODES:
        raise LogError(f"{path}: mode {mode!r} is none of trinary, scale, raw")
    return Rule(mode, free, occupied, _truth(path, header.get("negate", 0)))


_WORDS = {"true": True, "yes": True, "on": True, "y": True, "false": False, "no": False, "off": False, "n": False}


def _truth(path: Path, value: object) -> bool:
    """`negate` as a number, a truth value, or either of them in quotes. Raises LogError."""
    if isinstance(value, str):
        word = value.strip().lower()
        if word in _WORDS:
            return _WORDS[word]
        value = float(word) if _is_number(word) else value
    if isinstance(value, bool) or _finite(value):
        return bool(value)
    raise LogError(f"{path}: negate must be 0 or 1, not {value!r}")


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(path: Path, header: dict[str, Any], name: str, default: float | None = None, low: float = 0.0) -> float:
    value = header.get(name, default)
    if isinstance(value, str) and _is_number(value):
        value = float(value)
    if not _finite(value) or value < low:  # type: ignore[operator]
        raise LogError(f"{path}: {name} must be a number >= {low:g}, not {value!r}")
    return float(value)  # type: ignore[arg-type]


def _of_image(path: Path, header: dict[str, Any], max_mpx: float, read: Callable[[Image.Image], _T]) -> _T:
    """What `read` makes of the map's image. Raises LogError."""
    name = header.get("image")
    if not isinstance(name, str):
        raise LogError(f"{path}: names no image")
    image = path.parent / name
    if "\0" in name:
        raise LogError(f"{path}: its image {printable(name)!r} cannot be there")
    try:
        with Image.open(image) as opened:
            if opened.width * opened.height > max_mpx * 1e6:
                raise LogError(
                    f"{image}: {opened.width} x {opened.height} pixels are more than {max_mpx:g} million;"
                    " --max-map-mpx reads larger maps"
                )
            opened.load()
            return read(opened)
    except FileNotFoundError:
        raise LogError(f"{path}: its image {name!r} is not there") from None
    except LogError:
        raise
    except Exception as error:  # Pillow raises whatever the reader of the format trips over
        raise LogError(f"{image}: cannot be read as an image ({reason(error)})") from None
