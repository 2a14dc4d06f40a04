"""Memory never grows with a wrong number: absurd beams, ranges in another unit, limits that are not there."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfcli.core.grid import tiles
from pfcli.errors import FilterDegenerate
from pfcli.events import Scan
from tests.checks import mutations
from tests.checks.mutations import SCANS, Mutation
from tests.conftest import SAMPLES

Cli = Callable[..., subprocess.CompletedProcess[str]]


def _absurd(e: Any, t: float) -> Any:
    ranges = e.ranges_m.copy()
    if 3.0 < t < 3.3:
        ranges[60] = 3000.0
    return e._replace(ranges_m=ranges, range_max_m=float("inf"))


def test_one_absurd_beam_costs_one_beam(pfcli: Cli, tmp_path: Path) -> None:
    log = mutations.write(SAMPLES / "small-loop.mcap", tmp_path / "log.mcap", Mutation("spike", Scan, _absurd))
    done = pfcli("slam-gdr", log, "--out", tmp_path / "out", "--end", "30", "--truth", "auto", "--particles", "5")
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "out/run.json").read_text())
    assert summary["truth"]["ate_m"] < 0.05
    size = (tmp_path / "out/map.pgm").stat().st_size
    assert size < 4_000_000  # 100 m x 100 m


@pytest.mark.parametrize("name", ["scan-mm", "scan-cm"])
def test_ranges_in_another_unit_are_said_to_be_so(name: str, pfcli: Cli, tmp_path: Path) -> None:
    (mutation,) = [m for m in SCANS if m.name == name]
    log = mutations.write(SAMPLES / "small-loop.mcap", tmp_path / "log.mcap", mutation)
    done = pfcli("slam-gdr", log, "--out", tmp_path / "out", "--end", "20")
    assert done.returncode in (1, 3)  # nothing usable; or a run, whose result is in doubt
    assert "W301" in done.stderr


def test_maps_do_not_grow_beyond_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiles, "MOST", 40)
    maps = tiles.empty(1, 0.05, capacity=16)
    beams = tiles.Beams(np.zeros(2), np.array([[200.0, 0.0]]), np.ones(1, np.uint8), np.zeros(1))
    with pytest.raises(FilterDegenerate, match="more than 40 tiles"):
        tiles.draw(maps, np.zeros((1, 3)), np.ones(1, bool), beams)
