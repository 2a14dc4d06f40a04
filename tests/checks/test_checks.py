"""Every check: a log with the trouble has its finding, the log beside it has none."""

from pathlib import Path

import pytest

from pfcli.checks.log_check import check_log
from pfcli.replay.settings import Settings
from tests.checks import mutations
from tests.checks.mutations import LANDMARKS, ODOMETRY, SCANS, SOCCER, STAMPS, TICKS, Mutation
from tests.conftest import SAMPLES

_TOLD = [m for m in STAMPS + SCANS + ODOMETRY if m.code]


def _codes(path: Path) -> list[str]:
    return [found.code for found in check_log([path], Settings()).findings]


@pytest.mark.parametrize("name", [p.stem for p in sorted(SAMPLES.glob("*.mcap"))])
def test_samples_have_no_finding(name: str) -> None:
    assert _codes(SAMPLES / f"{name}.mcap") == []


@pytest.mark.parametrize("mutation", _TOLD, ids=lambda m: m.name)
def test_a_mistake_has_its_finding(mutation: Mutation, tmp_path: Path) -> None:
    assert mutation.code in _codes(mutations.write(SAMPLES / "small-loop.mcap", tmp_path / "log.mcap", mutation))


def test_writing_a_log_again_without_a_mistake_finds_nothing(tmp_path: Path) -> None:
    for name in ("small-loop", "four-rooms", "soccer"):
        assert _codes(mutations.write(SAMPLES / f"{name}.mcap", tmp_path / f"{name}.mcap")) == []


def test_line_points_in_mm_are_told(tmp_path: Path) -> None:
    (mm,) = [m for m in SOCCER if m.name == "lines-mm"]
    assert _codes(mutations.write(SAMPLES / "soccer.mcap", tmp_path / "log.mcap", mm)) == ["W402"]


def test_no_mistake_stands_in_the_table_twice() -> None:
    for group in (STAMPS, SCANS, ODOMETRY, TICKS, SOCCER, LANDMARKS):
        names = [m.name for m in group]
        assert len(names) == len(set(names))
