"""Maps as nav2_map_server reads them: every mode, depth, alpha, palette and YAML type, against its published rule."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

from pfcli.errors import LogError
from pfcli.formats import map_cells, map_yaml
from pfcli.formats.map_cells import Rule
from pfcli.formats.map_yaml import free_unknown


def _published(
    channels: list[float], alpha: float | None, mode: str, free: float, occupied: float, negate: bool
) -> int:
    """map_io.cpp, a pixel at a time: channels and alpha are 0 .. 1."""
    if mode == "trinary" and alpha is not None:
        channels = [*channels, alpha]
    shade = sum(channels) / len(channels)
    occ = shade if negate else 1.0 - shade
    if mode == "raw":
        percent = math.floor(shade * 255 + 0.5)
        return percent if percent <= 100 else -1
    if mode == "scale" and alpha is not None and alpha < 1.0:
        return -1
    if occupied < occ:
        return 100
    if occ < free:
        return 0
    return -1 if mode == "trinary" else round((occ - free) / (occupied - free) * 100.0)


@pytest.mark.parametrize("mode", map_cells.MODES)
@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize("alpha", [None, 0.0, 0.5, 1.0])
def test_grades_are_those_of_the_published_rule(mode: str, negate: bool, alpha: float | None) -> None:
    bright = np.arange(256) / 255.0
    rule = Rule(mode, 0.25, 0.65, negate)
    found = map_cells.grades(bright, None if alpha is None else np.full(256, alpha), rule)
    told = [_published([b] * 3, alpha, mode, 0.25, 0.65, negate) for b in bright.tolist()]
    assert found.tolist() == told


def _map(folder: Path, image: Image.Image, **header: Any) -> Path:
    image.save(folder / "m.png")
    known = {
        "image": "m.png",
        "resolution": 0.05,
        "origin": [0, 0, 0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    path = folder / "m.yaml"
    path.write_text(yaml.safe_dump(known | header))
    return path


_SHADES = np.array([[0, 50, 100, 205], [206, 220, 254, 255]], np.uint8)
_CELLS = [[1, 1, -1, -1], [0, 0, 0, 0]]


@pytest.mark.parametrize(
    "image",
    [
        Image.fromarray(_SHADES),
        Image.fromarray(_SHADES).convert("RGB"),
        Image.fromarray(_SHADES).convert("P"),
        Image.fromarray(_SHADES.astype(np.uint16) * 257),
    ],
    ids=["grey", "colour", "palette", "16 bit"],
)
def test_every_kind_of_image_reads_the_same(image: Image.Image, tmp_path: Path) -> None:
    assert map_yaml.read(_map(tmp_path, image)).cells[::-1].tolist() == _CELLS


def test_alpha_is_a_channel_in_trinary_and_unknown_in_scale(tmp_path: Path) -> None:
    grey = Image.fromarray(np.array([[0, 254]], np.uint8)).convert("LA")
    clear = grey.copy()
    clear.putalpha(0)
    assert map_yaml.read(_map(tmp_path, grey)).cells.tolist() == [[1, 0]]
    # (3 * 254 + 0) / 4 / 255 = 0.747 bright: 0.253 occupied
    assert map_yaml.read(_map(tmp_path, clear)).cells.tolist() == [[1, -1]]
    assert map_yaml.read(_map(tmp_path, clear, mode="scale")).cells.tolist() == [[-1, -1]]


def test_raw_is_an_occupancy_in_percent(tmp_path: Path) -> None:
    image = Image.fromarray(np.array([[0, 20, 49, 60, 66, 100, 101, 255]], np.uint8))
    assert map_yaml.read(_map(tmp_path, image, mode="raw")).cells.tolist() == [[0, 0, 0, -1, 1, 1, -1, -1]]


@pytest.mark.parametrize("value", [0, False, "0", "false", "no", "0.0"])
def test_negate_of_any_type_that_says_no(value: object, tmp_path: Path) -> None:
    path = _map(tmp_path, Image.fromarray(_SHADES), negate=value, free_thresh="0.196", occupied_thresh="0.65")
    assert map_yaml.read(path).cells[::-1].tolist() == _CELLS


@pytest.mark.parametrize("value", [1, True, "1", "true", "YES"])
def test_negate_of_any_type_that_says_yes(value: object, tmp_path: Path) -> None:
    assert map_yaml.read(_map(tmp_path, Image.fromarray(255 - _SHADES), negate=value)).cells[::-1].tolist() == _CELLS


def test_negate_that_says_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="negate must be 0 or 1, not 'maybe'"):
        map_yaml.read(_map(tmp_path, Image.fromarray(_SHADES), negate="maybe"))


def test_the_grey_of_unknown_cells_is_told_where_it_is_free_and_kept_unknown_on_request(tmp_path: Path) -> None:
    old = _map(tmp_path, Image.fromarray(_SHADES), free_thresh=0.25)
    assert free_unknown(old) == (1 / 8, 0.25)
    assert map_yaml.read(old).cells[::-1].tolist() == [[1, 1, -1, 0], [0, 0, 0, 0]]
    assert map_yaml.read(old, unknown_grey=205).cells[::-1].tolist() == _CELLS
    assert free_unknown(_map(tmp_path, Image.fromarray(_SHADES)))[0] == 0.0
