"""Metrics: hand-made cases, and agreement with evo on the same files."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pfcli.core.evaluation import map_quality, relation_error, se2, spread, track_error
from pfcli.core.grid.grid_map import GridMap
from pfcli.errors import LogError
from pfcli.events import Pose2
from pfcli.formats import tum
from pfcli.formats.relations import Relation

EVO = """
import json, sys
from evo.core import metrics
from evo.tools import file_interface
truth, track = (file_interface.read_tum_trajectory_file(p) for p in sys.argv[2:])
track.align(truth)
kind = metrics.PoseRelation.translation_part
metric = metrics.APE(kind) if sys.argv[1] == "ape" else metrics.RPE(kind, 1, metrics.Unit.frames)
metric.process_data((truth, track))
print(json.dumps(metric.get_all_statistics()))
"""


def _tracks(n: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    t = np.linspace(0, 20, n)
    truth = np.column_stack([3 * np.cos(t / 3), 2 * np.sin(t / 2), np.unwrap(np.sin(t / 4))])
    noisy = truth + rng.normal(0, [0.05, 0.05, 0.02], (n, 3))
    moved = se2.compose(np.array([[1.0, -2.0, 0.7]]), noisy)
    return (1_600_000_000 * 10**9 + (t * 1e9)).astype(np.int64), truth, moved


def test_alignment_undoes_any_rigid_motion() -> None:
    _, truth, _ = _tracks()
    away = se2.compose(np.array([[3.0, 1.0, -2.0]]), truth)
    back = se2.compose(track_error.align_se2(away, truth)[None], away)
    assert back[:, :2] == pytest.approx(truth[:, :2], abs=1e-9)


@pytest.mark.parametrize("tool", ["ape", "rpe"])
def test_ate_and_rpe_agree_with_evo(tool: str, tmp_path: Path) -> None:
    stamps, truth, track = _tracks()
    tum.write(tmp_path / "truth.tum", stamps, truth)
    tum.write(tmp_path / "track.tum", stamps, track)
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", EVO, tool, tmp_path / "truth.tum", tmp_path / "track.tum"],
        capture_output=True,
        text=True,
        env={**os.environ, "HOME": str(tmp_path)},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    evo = json.loads(done.stdout)
    read_stamps, a = tum.read(tmp_path / "track.tum")
    _, b = tum.read(tmp_path / "truth.tum")
    if tool == "ape":
        errors = track_error.errors_against(read_stamps, a, read_stamps, b, track_error.align_se2).position_m
    else:
        errors, _ = track_error.relative_errors(a, b)
    # evo aligns in SE(3); for planar tracks that is the SE(2) answer
    assert np.sqrt((errors**2).mean()) == pytest.approx(evo["rmse"], rel=1e-4)
    assert errors.max() == pytest.approx(evo["max"], rel=1e-3)


def test_relation_errors_of_a_perfect_track_are_zero() -> None:
    poses = np.array([[0.0, 0, 0], [1, 0, np.pi / 2], [1, 2, np.pi]])
    relations = [Relation("10.5", "12.5", 1.0, 2.0, np.pi), Relation("11.50000", "12.5", 2.0, 0.0, np.pi / 2)]
    found = relation_error.relation_errors(relations, ["10.5", "11.5", "12.5"], poses)
    assert found.translation_m == pytest.approx(0, abs=1e-12)
    assert found.rotation_rad == pytest.approx(0, abs=1e-12)
    assert found.scans_apart.tolist() == [2, 1]


def test_relations_that_fit_nothing_show_both_spans() -> None:
    with pytest.raises(LogError, match=r"99\.0.*10\.5.*11\.5"):
        relation_error.relation_errors([Relation("99.0", "99.5", 0, 0, 0)], ["10.5", "11.5"], np.zeros((2, 3)))


def test_tracks_without_overlap_show_both_spans() -> None:
    with pytest.raises(LogError, match="spans"):
        track_error.associate(np.array([10**9]), np.array([10**12, 2 * 10**12]), 10**7)


def test_the_bootstrap_interval_covers_the_mean_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    runs, covered = 200, 0
    for k in range(runs):
        low, high = spread.block_bootstrap(rng.exponential(1.0, 200), seed=k, rounds=200)
        covered += low <= 1.0 <= high
    # nominal 0.95; a block bootstrap of 200 skewed values undershoots a little
    assert covered / runs > 0.95 - 5 * np.sqrt(0.95 * 0.05 / runs)


def _room(double: int = 0) -> GridMap:
    cells = np.zeros((80, 100), np.int8)
    cells[10, 10:90] = cells[70, 10:90] = 1
    cells[10:71, 10] = cells[10:71, 89] = 1
    if double:
        cells[10 + double, 10:90] = 1
    return GridMap(cells, 0.05, Pose2())


def test_a_wall_drawn_twice_raises_the_doubled_wall_score() -> None:
    clean = map_quality.doubled_walls(_room())
    assert clean < 0.2  # the four corners
    # two rows of 78 cells are filled, along 2 x 280 + 2 x 80 bordering cells: 0.22
    assert map_quality.doubled_walls(_room(3)) == pytest.approx(clean + 0.22, abs=0.02)
    assert map_quality.doubled_walls(_room(20)) < clean + 0.1


def test_the_doubled_wall_score_does_not_reward_thick_walls() -> None:
    thick = _room()
    cells = thick.cells.copy()
    cells[9, 10:90] = cells[71, 10:90] = 1
    assert map_quality.doubled_walls(GridMap(cells, 0.05, Pose2())) == pytest.approx(
        map_quality.doubled_walls(thick), rel=0.05
    )


def test_iou_is_one_for_the_same_map_and_low_for_another() -> None:
    assert map_quality.map_iou(_room(), _room(), Pose2()).iou == pytest.approx(1.0)
    assert map_quality.map_iou(_room(), _room(), Pose2(0.3, 0.3, 0.0)).iou < 0.3


def test_interpolation_is_nan_outside_and_across_gaps() -> None:
    stamps = np.array([0, 10, 5 * 10**9, 5 * 10**9 + 10], np.int64)
    poses = np.array([[0.0, 0, 3.1], [1, 0, -3.1], [2, 0, 0], [3, 0, 0]])
    out = track_error.interpolate(np.array([5, 10**9, 9 * 10**9]), stamps, poses)
    assert out[0, :2] == pytest.approx([0.5, 0])
    assert abs(out[0, 2]) == pytest.approx(np.pi, abs=1e-9)
    assert np.isnan(out[1:]).all()
