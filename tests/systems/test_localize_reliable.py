"""Pose, classes and success together; global samples on one scale with the tracker; the defects of the public code."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pfcli.core.grid.grid_map import GridMap
from pfcli.core.sensor import class_conditional
from pfcli.errors import LogError, UsageError
from pfcli.events import Pose2
from pfcli.formats import map_yaml
from pfcli.initial import Initial
from pfcli.registry import system
from pfcli.replay import align
from pfcli.replay.log import Log
from pfcli.runs import loop
from pfcli.systems.localize_reliable import first_particles, global_sampler, success_decision
from pfcli.systems.localize_reliable.map_models import load, model_of, view_of
from pfcli.systems.localize_reliable.misalignment import _posteriors, misaligned_share
from pfcli.systems.localize_reliable.params import Params
from pfcli.systems.localize_reliable.protection_level import protection_level_m, radius_of, surface_variance
from pfcli.systems.localize_reliable.run_tables import RunTables
from pfcli.systems.localize_reliable.success_decision import Classifier, View
from pfcli.systems.localize_reliable.success_report import Judged

Cli = Callable[..., "subprocess.CompletedProcess[str]"]
SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
VIEW = View(np.array([0.1, 0.0, 0.0]), np.linspace(-1.5, 1.5, 61), 30.0)


def test_the_kernel_density_has_mass_one() -> None:
    """Defect 3 of the public code: its constant was 2.30 where 63.5 is right."""
    poses = np.array([[0.0, 0.0, 3.1], [0.2, 0.1, -3.1]])
    xy, turn = np.arange(-0.6, 0.8, 0.04), np.linspace(-np.pi, np.pi, 180, endpoint=False)
    at = np.stack(np.meshgrid(xy, xy, turn), axis=-1).reshape(-1, 3)
    found = global_sampler.density(at, poses, np.array([0.3, 0.7]), 0.1, 0.1)
    assert found.sum() * 0.04**2 * 2 * np.pi / 180 == pytest.approx(1.0, abs=2e-3)
    peak = global_sampler.density(np.zeros((1, 3)), np.zeros((1, 3)), np.ones(1), 0.1, 0.1)[0]
    assert peak == pytest.approx((2 * np.pi) ** -1.5 / 0.1**3)


def test_global_samples_are_weighed_by_prediction_over_proposal() -> None:
    """Akai 2023, section 4: drawn from the tracker's own density they weigh as much as its particles, which keep half."""
    rng = np.random.default_rng(1)
    poses = rng.normal(0, [0.3, 0.3, 0.1], (2000, 3))
    samples = rng.normal(0, [0.3, 0.3, 0.1], (1500, 3))
    log = global_sampler.log_importance(samples, poses, np.full(2000, 1 / 2000), 1e-9, 1000.0, np.zeros(1500))
    assert abs(np.log(2.0 * np.mean(np.exp(log)))) < 0.1
    assert np.mean(global_sampler.halved(poses, samples) == np.log(0.5)) > 0.99
    assert (global_sampler.halved(poses + np.array([20.0, 0.0, 0.0]), samples) == 0.0).all()
    assert (global_sampler.halved(poses + np.array([0.0, 0.0, 1.5]), samples) == 0.0).all()
    far = global_sampler.log_importance(
        samples + np.array([20.0, 0.0, 0.0]), poses, np.full(2000, 1 / 2000), 1e-6, 1000.0, np.ones(1500)
    )
    assert far == pytest.approx(1.0 + np.log(1e-6 / (1000 * 2 * np.pi)) - np.log(_own(samples)), abs=1e-6)


def _own(samples: np.ndarray) -> np.ndarray:
    return np.asarray(global_sampler.density(samples, samples, np.full(len(samples), 1 / len(samples)), 0.1, 0.05))


def test_a_terrible_residual_never_becomes_no_evidence() -> None:
    """Defect 6 of the public code: beyond both histograms its two densities were equal."""
    from pfcli.core.sensor.class_conditional import Fit

    found = Classifier(np.array([-2.0, 1.0, -60.0]), 0.5, 0.9, (61.0, 3.0, 30.0))
    worse = [
        success_decision.log_ratio(Fit(np.zeros(1), np.array([mae]), np.array([hits]), np.array([through])), found)[0]
        for mae, hits, through in ((0.02, 0.95, 0.0), (0.3, 0.5, 0.05), (5.0, 0.0, 1.0), (1e3, 0.0, 1.0))
    ]
    assert worse == sorted(worse, reverse=True)
    assert worse[-1] < -5.0


@pytest.fixture(scope="module")
def learnt() -> tuple[Classifier, str]:
    from pfcli import registry
    from pfcli.params import build
    from pfcli.runs import loop

    system = registry.system("localize-reliable")
    params = build(system.params, {}, "test")
    place = load(params, loop.Job(system, params, [], map=SAMPLES / "kidnapped.yaml"))
    model = model_of(params, 30.0)
    rng = np.random.default_rng(0)
    return success_decision.learn(place.free_xy, place.field, model, VIEW, rng, 800), place.digest


def test_the_decision_is_learnt_from_the_map_and_holds_on_poses_that_were_kept_back(
    learnt: tuple[Classifier, str],
) -> None:
    found, _ = learnt
    assert found.accuracy > 0.7  # the wrong places are the best of a thousand; guessing has 0.5 +- 0.025
    assert found.slope[0] <= 0.0
    assert found.slope[1] >= 0.0
    assert found.slope[2] < 0.0


def test_a_classifier_survives_its_file_and_no_other_map_or_sensor(
    learnt: tuple[Classifier, str], tmp_path: Path
) -> None:
    found, digest = learnt
    path = tmp_path / "c.json"
    success_decision.save(path, found, digest)
    again = success_decision.load(path, digest, VIEW)
    assert np.array_equal(again.slope, found.slope)
    with pytest.raises(UsageError, match="another map"):
        success_decision.load(path, "x" * 64, VIEW)
    with pytest.raises(UsageError, match="31 over"):
        success_decision.load(path, digest, VIEW._replace(angles=np.linspace(-1, 1, 31)))
    path.write_text("{}")
    with pytest.raises(LogError, match="no classifier"):
        success_decision.load(path, digest, VIEW)


def test_the_chain_over_residuals_equals_the_sum_over_all_class_paths() -> None:
    import itertools

    stay = np.array([[0.8, 0.0, 0.2], [0.0, 0.8, 0.2], [1 / 3, 1 / 3, 1 / 3]])
    density = np.random.default_rng(2).uniform(0.1, 2.0, (5, 3))
    slow = np.zeros((5, 3))
    for path in itertools.product(range(3), repeat=5):
        p = density[0, path[0]] / 3
        for k in range(1, 5):
            p *= stay[path[k - 1], path[k]] * density[k, path[k]]
        for k in range(5):
            slow[k, path[k]] += p
    assert _posteriors(density, stay) == pytest.approx(slow / slow.sum(axis=1, keepdims=True))


def test_a_shifted_scan_looks_misaligned_and_a_matched_one_does_not() -> None:
    rng = np.random.default_rng(3)
    assert misaligned_share(np.abs(rng.normal(0, 0.03, 60)), 0.05) < 0.05
    assert misaligned_share(np.full(60, 0.35), 0.05) > 0.5


def test_the_protection_level_holds_for_a_gaussian_and_gives_up_without_reliability() -> None:
    grid = GridMap(np.zeros((300, 400), np.int8), 0.1, Pose2())
    cov = np.diag([0.05**2, 0.03**2, 0.01])
    rng, surface = np.random.default_rng(4), 0.04**2
    bound = protection_level_m(cov, 1.0, grid, surface)
    error = np.hypot(*(rng.normal(0, [0.05, 0.03], (400_000, 2)) + rng.normal(0, 0.04, (400_000, 2))).T)
    assert np.mean(error <= bound) == pytest.approx(0.99, abs=4 * np.sqrt(0.01 / 400_000))
    # a map knows no surface better than its cells: four of them, each anywhere in one
    bound = protection_level_m(cov, 1.0, grid, 0.0)
    cells = rng.uniform(-0.05, 0.05, (400_000, 2, 4)).mean(axis=2)
    error = np.hypot(*(rng.normal(0, [0.05, 0.03], (400_000, 2)) + cells).T)
    assert np.mean(error <= bound) == pytest.approx(0.99, abs=1e-3)
    for small, risk in ((1.0, 0.01), (0.2, 0.003), (0.0, 0.05)):
        error = np.sort(np.hypot(*rng.normal(0, [1.0, max(small, 1e-9) ** 0.5], (400_000, 2)).T))
        exact, spread = (
            radius_of(risk, 1.0, small),
            4 * np.sqrt(risk / 400_000),
        )  # four standard deviations of the share
        assert error[int((1 - risk - spread) * error.size)] <= exact <= error[int((1 - risk + spread) * error.size)]
    assert protection_level_m(cov, 0.98, grid, surface) == pytest.approx(50.0)
    assert surface_variance(np.array([0.0, 0.06, 0.06])) == pytest.approx(0.0024)
    assert protection_level_m(cov, 1.0, grid, surface_variance(np.empty(0))) == pytest.approx(50.0)


def test_what_is_learnt_of_a_map_is_kept_and_the_same_either_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Found in the cache, learnt anew, beside a damaged file, or where nothing can be kept: the same decision."""
    monkeypatch.setenv("PFCLI_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(success_decision.learn, "__defaults__", (40,))
    place = SAMPLES / "kidnapped.yaml"
    job = loop.Job(system("localize-reliable"), Params(), [], 0, map=place, initial=Initial("inside"))
    assets = load(Params(), job)
    sweep = next(iter(align.bare(Log(SAMPLES / "kidnapped.mcap").events(["scan"]))))
    model = model_of(Params(), 30.0)
    learnt = first_particles.classifier_for(sweep, model, assets, Params())
    (file,) = (tmp_path / "cache" / "classifiers").iterdir()
    with monkeypatch.context() as only_kept:
        only_kept.setattr(success_decision, "learn", None)
        assert _same(first_particles.classifier_for(sweep, model, assets, Params()), learnt)
    file.write_text("{")
    assert _same(first_particles.classifier_for(sweep, model, assets, Params()), learnt)
    assert _same(success_decision.load(file, assets.digest, view_of(sweep, Params())), learnt)
    first_particles.classifier_for(sweep, model._replace(sigma_m=0.1), assets, Params())
    assert len(list(file.parent.iterdir())) == 2
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PFCLI_CACHE_DIR", str(tmp_path / "file"))
    assert _same(first_particles.classifier_for(sweep, model, assets, Params()), learnt)


def _same(a: Classifier, b: Classifier) -> bool:
    return bool((a.slope == b.slope).all()) and a[1:] == b[1:]


@pytest.mark.parametrize("good_mae", [0.0, 0.5])
@pytest.mark.parametrize("good_hits", [0.0, 0.5])
def test_neither_a_larger_residual_nor_fewer_hits_speak_for_success(good_mae: float, good_hits: float) -> None:
    """Where walls are drawn thick the best wrong place fits better than the true one: then neither says anything."""
    rng = np.random.default_rng(6)
    pairs = rng.multivariate_normal([0.0, 0.0], [[0.3, -0.2], [-0.2, 0.3]], 800)
    through = rng.exponential(0.02, (800, 2))
    good = np.column_stack([pairs[:400, 0] + good_mae, pairs[:400, 1] + good_hits, through[:400, 0]])
    bad = np.column_stack([pairs[400:, 0] + 0.25, pairs[400:, 1] + 0.25, 3.0 * through[400:, 1]])
    found = success_decision._separate(good, bad, VIEW)
    assert found.slope[0] <= 0.0 <= found.slope[1]
    assert found.slope[2] < 0.0
    assert found.accuracy > 0.5
    backwards = success_decision._separate(
        np.column_stack([good[:, :2], bad[:, 2]]), np.column_stack([bad[:, :2], good[:, 2]]), VIEW
    )
    assert backwards.slope[2] <= 0.0


def test_recoveries_are_told_by_lost_trust_or_by_a_jump() -> None:
    tables = RunTables(GridMap(np.zeros((9, 9), np.int8), 1.0, Pose2()), False)
    ends, last, nothing = np.empty((2, 1), np.float32), np.zeros(3), np.zeros(1)
    fit = class_conditional.Fit(nothing, nothing, nothing, nothing)
    track = [(0.9, 0.0), (0.9, 0.0), (0.2, 0.0), (0.3, 0.0), (0.8, 4.0), (0.9, 4.0), (0.9, 8.0)]
    for k, (p, x) in enumerate(track):
        pose = np.array([x, 0.0, 0.0])
        says = Judged(
            p_success=p,
            precision=1.0,
            fit=fit,
            p_unknown=nothing,
            unknown=np.zeros(1, np.bool_),
            away_m=nothing,
            protection_m=0.1,
        )
        tables.add(k * 10**9, pose, says, ends, last)
        last = pose
    first, second = tables.recoveries()
    assert (first["lost_s"], first["after_s"], first["moved_m"]) == (2.0, 2.0, 4.0)
    assert (second["lost_s"], second["after_s"]) == (5.0, 1.0)


def _run(pfcli: Cli, out: Path, *words: object) -> dict[str, object]:
    log, place = SAMPLES / "kidnapped.mcap", SAMPLES / "kidnapped.yaml"
    done = pfcli("localize-reliable", log, "--map", place, "--out", out, "--truth", "auto", "--json", *words)
    assert done.returncode == 0, done.stderr
    found: dict[str, object] = json.loads(done.stdout)
    return found


def test_a_carried_robot_finds_itself_and_writes_what_it_promises(pfcli: Cli, tmp_path: Path) -> None:
    found = _run(pfcli, tmp_path / "a", "--beams-table", "--overlay")
    assert len(found["recoveries"]) >= 1  # type: ignore[arg-type]
    assert found["truth"]["median_m"] < 0.03  # type: ignore[index]
    beams = pq.read_table(tmp_path / "a/beams.parquet")
    assert beams.num_rows == found["updates"]
    layer, place = (map_yaml.read(f) for f in (tmp_path / "a/unknown_obstacles.yaml", tmp_path / "a/map.yaml"))
    assert layer.cells.shape == place.cells.shape
    track = pq.read_table(tmp_path / "a/track.parquet")
    assert {"p_success", "protection_m"} <= set(track.column_names)


def test_without_global_samples_a_carried_robot_knows_that_it_is_lost(pfcli: Cli, tmp_path: Path) -> None:
    start = next(iter(Log(SAMPLES / "kidnapped.mcap").events(["truth"])))
    _run(pfcli, tmp_path / "a", "--no-use-gl", "--initial", f"{start[1]},{start[2]},{start[3]}")
    track = pq.read_table(tmp_path / "a/track.parquet").to_pydict()
    error, p = np.array(track["error_m"]), np.array(track["p_success"])
    assert np.mean(p[error > 1.0] < 0.5) > 0.9


@pytest.mark.parametrize("words", [("--range-model", "beam", "--gl-steps", 0), ("--match-samples", 60)])
def test_every_switch_finds_a_carried_robot(words: tuple[object, ...], pfcli: Cli, tmp_path: Path) -> None:
    found = _run(pfcli, tmp_path / "a", *words)
    assert found["truth"]["median_m"] < 0.03  # type: ignore[index]


@pytest.mark.parametrize(
    ("words", "told"),
    [(["--initial", "outside"], "knows no outside"), (["--classifier", "none.json"], "none.json: cannot be read")],
)
def test_bad_input_is_one_line(words: list[str], told: str, pfcli: Cli, tmp_path: Path) -> None:
    log, place = SAMPLES / "kidnapped.mcap", SAMPLES / "kidnapped.yaml"
    done = pfcli("localize-reliable", log, "--map", place, "--out", tmp_path / "o", *words)
    assert done.returncode in (1, 2)
    assert told in done.stderr
    assert not (tmp_path / "o").exists()


def test_calibrate_writes_a_classifier_that_the_system_takes(pfcli: Cli, tmp_path: Path) -> None:
    log, place, out = SAMPLES / "kidnapped.mcap", SAMPLES / "kidnapped.yaml", tmp_path / "c.json"
    done = pfcli("calibrate", place, log, "--out", out, "--poses", 400, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["accuracy"] > 0.75
    assert _run(pfcli, tmp_path / "a", "--classifier", out, "--end", 20)["updates"]
    assert "exists" in pfcli("calibrate", place, log, "--out", out).stderr
