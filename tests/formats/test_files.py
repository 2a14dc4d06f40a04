"""Maps, tracks, tables and relations as files."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from PIL import Image

from pfcli.core.grid.grid_map import GridMap
from pfcli.errors import LogError
from pfcli.events import Pose2
from pfcli.formats import map_yaml, parquet, relations, tum


def test_a_map_survives_writing_and_reading(tmp_path: Path) -> None:
    cells = np.array([[0, 1, -1], [1, 1, 0]], np.int8)
    map_yaml.write(tmp_path, GridMap(cells, 0.05, Pose2(-1.1, 2.3000000000000003, 0.0)))
    back = map_yaml.read(tmp_path / "map.yaml")
    assert (back.cells == cells).all()
    assert back.origin == (-1.1, 2.3000000000000003, 0.0)
    assert (tmp_path / "map.pgm").read_bytes().startswith(b"P5\n3 2\n255\n")


@pytest.mark.parametrize("negate", [0, 1])
def test_negate_modes_and_png(negate: int, tmp_path: Path) -> None:
    shades = np.array([[0, 254, 205]], np.uint8)
    Image.fromarray(255 - shades if negate else shades).save(tmp_path / "m.png")
    text = f"image: m.png\nresolution: 0.1\norigin: [1, 2, 0.5]\nnegate: {negate}\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    (tmp_path / "m.yaml").write_text(text)
    found = map_yaml.read(tmp_path / "m.yaml")
    assert found.cells.tolist() == [[1, 0, -1]]
    assert found.origin == (1, 2, 0.5)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("image: gone.pgm", "gone.pgm"),
        ("resolution: 0", "resolution"),
        ("free_thresh: 0.9", "free_thresh"),
        ("mode: odd", "mode"),
        ("origin: here", "origin"),
    ],
)
def test_a_bad_map_names_file_and_field(change: str, says: str, tmp_path: Path) -> None:
    map_yaml.write(tmp_path, GridMap(np.zeros((2, 2), np.int8), 0.05, Pose2()))
    lines = (tmp_path / "map.yaml").read_text().splitlines()
    key = change.split(":")[0]
    (tmp_path / "map.yaml").write_text("\n".join(change if line.startswith(key + ":") else line for line in lines))
    with pytest.raises(LogError, match=says) as error:
        map_yaml.read(tmp_path / "map.yaml")
    assert "map.yaml" in str(error.value)
    assert "\n" not in str(error.value)


def test_tum_keeps_every_nanosecond(tmp_path: Path) -> None:
    stamps = np.array([1_700_000_000_123_456_789, 1_700_000_001_000_000_001], np.int64)
    poses = np.array([[1.5, -2.25, 3.0], [0.0, 0.0, -3.1]])
    tum.write(tmp_path / "t.tum", stamps, poses)
    assert (tmp_path / "t.tum").read_text().startswith("1700000000.123456789 1.500000 -2.250000 0.0 0.0 0.0 ")
    back_stamps, back = tum.read(tmp_path / "t.tum")
    assert (back_stamps == stamps).all()
    assert back == pytest.approx(poses, abs=1e-6)


def test_a_bad_tum_line_is_named(tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text("# t x y\n1.0 0 0 0 0 0 0 1\n2.0 0 0\n")
    with pytest.raises(LogError, match="line 3"):
        tum.read(tmp_path / "t.tum")


def test_parquet_carries_units_and_provenance(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    class Row(NamedTuple):
        t_ns: int
        spread_m: float
        name: str
        ok: bool

    columns = parquet.columns_of([Row(1, 0.5, "a", True), Row(2, 1.5, "b", False)], Row)
    parquet.write(tmp_path / "x.parquet", columns, {"seed": 3})
    schema = pq.read_schema(tmp_path / "x.parquet")
    assert schema.field("spread_m").metadata == {b"unit": b"m"}
    assert parquet.provenance(tmp_path / "x.parquet") == {"seed": 3}
    assert parquet.read(tmp_path / "x.parquet")["name"] == ["a", "b"]


def test_relations_are_read_and_bad_lines_named(tmp_path: Path) -> None:
    (tmp_path / "r").write_text("1.0 2.0 0.5 0.1 0 0 0 0.2\n")
    assert relations.read(tmp_path / "r")[0] == ("1.0", "2.0", 0.5, 0.1, 0.2)
    (tmp_path / "r").write_text("1.0 2.0 0.5 0.1 0 0 0 0.2\nnonsense\n")
    with pytest.raises(LogError, match="line 2"):
        relations.read(tmp_path / "r")
