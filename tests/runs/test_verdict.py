"""The verdict about a result: measures that need no truth, and the rules over them."""

from pathlib import Path

import numpy as np
import pytest

from pfcli.checks.evidence import Evidence
from pfcli.core.grid.grid_map import GridMap
from pfcli.events import Pose2, Scan
from pfcli.findings import Finding
from pfcli.runs.agreement import Agreement, agreement
from pfcli.runs.verdict import finding_of, judge
from pfcli.systems.shared.contract import Result, Track

_FINE = Agreement(with_pose=1.0, jumps=0, settled=1.0, way_ratio=1.0, fit=0.95, fit_worst=0.9, doubled=float("nan"))


def _room(offset_m: float) -> tuple[Result, Evidence]:
    """A robot in the middle of a 4 m x 4 m room whose track says that it stands `offset_m` aside."""
    cells = np.full((100, 100), -1, np.int8)
    cells[10:90, 10:90] = 0
    cells[[10, 89], 10:90] = cells[10:90, [10, 89]] = 1
    grid = GridMap(cells, 0.05, Pose2(-2.5, -2.5, 0.0))
    angle = np.linspace(-np.pi, np.pi, 180, endpoint=False)
    ranges = 1.975 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    evidence, stamps = Evidence(Path("log")), np.arange(60, dtype=np.int64) * 100_000_000
    for stamp in stamps.tolist():
        step = (angle[0], angle[1] - angle[0])
        evidence.event(Scan(stamp, ranges.astype(np.float32), *step, 0.1, 8.0, Pose2()))
        evidence.moved(stamp, (0.0, 0.0, 0.0))
    poses = np.tile([offset_m, 0.0, 0.0], (60, 1))
    return Result(Track(stamps, poses, {}), grid, [], {}, given_frame=True), evidence


def test_scans_lie_on_the_map_where_the_robot_is_and_not_where_it_is_not() -> None:
    assert agreement(*_room(0.0)).fit > 0.99
    assert agreement(*_room(0.7)).fit < 0.6


def test_a_jump_parts_the_track_and_its_length_is_no_way() -> None:
    result, evidence = _room(0.0)
    poses = result.track.poses.copy()
    poses[45:, 0] = 1.0
    poses[50:] = np.nan
    found = agreement(result._replace(track=result.track._replace(poses=poses)), evidence)
    assert found.jumps == 1
    assert found.settled == pytest.approx(45 / 50)
    assert found.with_pose == pytest.approx(50 / 60)


def _grade(**changed: float) -> str:
    return judge(_FINE._replace(**changed), ()).grade  # type: ignore[arg-type]


def test_rules_grade_by_the_worst_measure() -> None:
    assert _grade() == "good"
    assert _grade(fit=0.6) == "doubtful"
    assert _grade(fit=0.3) == "wrong"
    assert _grade(settled=0.2) == "wrong"
    assert _grade(with_pose=0.5) == "doubtful"
    assert _grade(way_ratio=0.3) == "wrong"
    assert _grade(fit=float("nan"), fit_worst=float("nan"), doubled=0.4) == "good"


def test_what_was_found_about_the_input_counts() -> None:
    def finding(code: str, severity: str) -> Finding:
        return Finding(code=code, severity=severity, where="", seen="", effect="", way_out="")  # type: ignore[arg-type]

    assert judge(_FINE, [finding("W304", "doubt")]).grade == "wrong"
    assert judge(_FINE, [finding("W102", "doubt")]).grade == "doubtful"
    assert judge(_FINE, [finding("W106", "note")]).grade == "good"
    assert finding_of(judge(_FINE, [finding("W304", "doubt")])) == []


def test_the_verdict_is_a_finding_where_the_measures_say_so() -> None:
    (wrong,) = finding_of(judge(_FINE._replace(fit=0.3), ()))
    assert (wrong.code, wrong.severity) == ("W701", "doubt")
    assert "30 % of what was seen lies on the map" in wrong.seen
    (doubtful,) = finding_of(judge(_FINE._replace(fit=0.6), ()))
    assert (doubtful.code, doubtful.severity) == ("W702", "note")
