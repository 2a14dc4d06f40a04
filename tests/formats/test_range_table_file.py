"""Range tables in the cache: kept, rebuilt when in doubt, safe when two build or one is killed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from pfcli.core.grid.grid_map import GridMap
from pfcli.errors import OutputError
from pfcli.events import Pose2
from pfcli.formats import range_table_file


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PFCLI_CACHE_DIR", str(tmp_path))
    return tmp_path


def _grid(seed: int = 0) -> GridMap:
    cells = (np.random.default_rng(seed).random((30, 40)) < 0.1).astype(np.int8)
    return GridMap(cells, 0.1, Pose2(1.0, 2.0, 0.0))


def test_a_second_load_takes_what_is_there_and_another_map_does_not(cache: Path) -> None:
    first = range_table_file.load(_grid(), 72, 5.0)
    again = range_table_file.load(_grid(), 72, 5.0)
    assert (first.origin, again.origin) == ("built", "kept")
    assert np.array_equal(first.table.ranges, again.table.ranges)
    for other in (_grid(1), _grid()._replace(resolution_m=0.2), _grid()._replace(origin=Pose2(0.0, 0.0, 0.1))):
        assert range_table_file.load(other, 72, 5.0).origin == "built"
    assert range_table_file.load(_grid(), 90, 5.0).origin == "built"
    assert range_table_file.load(_grid(), 72, 6.0).origin == "built"


@pytest.mark.parametrize("harm", ["flip", "cut", "foreign", "empty", "other map"])
def test_what_cannot_be_trusted_is_built_again(harm: str, cache: Path) -> None:
    good = range_table_file.load(_grid(), 72, 5.0)
    expected = np.array(good.table.ranges)
    data = bytearray(good.path.read_bytes())
    if harm == "flip":
        data[len(data) // 2] ^= 1
    elif harm == "cut":
        data = data[:-5]
    elif harm == "foreign":
        data = bytearray(b"P5 1 1 255 0" * 1000)
    elif harm == "empty":
        data = bytearray()
    else:
        data = bytearray(range_table_file.load(_grid(1), 72, 5.0).path.read_bytes())
    good.path.unlink()
    good.path.write_bytes(data)
    again = range_table_file.load(_grid(), 72, 5.0)
    assert again.origin.startswith("rebuilt: ")
    assert np.array_equal(again.table.ranges, expected)


def test_every_single_flipped_word_changes_the_checksum() -> None:
    ranges = np.random.default_rng(0).integers(0, 65536, (70, 73)).astype(np.uint16)
    before = range_table_file.checksum(ranges)
    for k in range(0, ranges.size, 37):
        ranges.ravel()[k] ^= 1 << (k % 16)
        assert range_table_file.checksum(ranges) != before
        ranges.ravel()[k] ^= 1 << (k % 16)


def test_a_cache_that_cannot_be_written_is_one_clear_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "a file"
    file.write_text("")
    monkeypatch.setenv("PFCLI_CACHE_DIR", str(file / "below"))
    with pytest.raises(OutputError, match="--ranges rays"):
        range_table_file.load(_grid(), 72, 5.0)


_BUILD = """
import sys
from pathlib import Path
from pfcli.formats import map_yaml, range_table_file
print(range_table_file.load(map_yaml.read(Path(sys.argv[1])), 360, 30.0).origin)
"""


def test_two_that_build_at_once_and_one_that_is_killed_leave_a_whole_table(tmp_path: Path) -> None:
    from pfcli.formats import map_yaml
    from pfcli.simulation.indoor_world import WORLDS, rasterize

    map_yaml.write(tmp_path, rasterize(WORLDS["office"](1), 0.1))
    env = os.environ | {"PFCLI_CACHE_DIR": str(tmp_path / "cache")}
    words = [sys.executable, "-c", _BUILD, str(tmp_path / "map.yaml")]
    killed = subprocess.Popen(words, env=env, stdout=subprocess.PIPE)
    folder = tmp_path / "cache" / "range-tables"
    for _ in range(600):
        if list(folder.glob(".*.part*")):
            break
        time.sleep(0.05)
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    two = [subprocess.Popen(words, env=env, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    origins = [p.communicate(timeout=120)[0].strip() for p in two]
    assert all(p.returncode == 0 for p in two)
    assert set(origins) <= {"built", "kept", "rebuilt: its checksum is wrong"}
    assert not list(folder.glob(".*.part*"))
    last = subprocess.run(words, env=env, capture_output=True, text=True, check=True)
    assert last.stdout.strip() == "kept"
