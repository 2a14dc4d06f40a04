"""Headings from one match, ranges from a table: both variants on small worlds, and what happens to a lost robot."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pfcli.core.resample import multinomial
from pfcli.core.sensor import range_beams
from pfcli.core.weights import normalize
from pfcli.errors import UsageError
from pfcli.events import Pose2, Ranges, Scan, Sounding, Sweep
from pfcli.formats import map_yaml
from pfcli.initial import Initial
from pfcli.registry import filter_of, system
from pfcli.runs.loop import Job
from pfcli.simulation.indoor_world import WORLDS, rasterize
from pfcli.systems.localize_lookup import smc_start
from pfcli.systems.localize_lookup.expected_ranges import Assets, evidence
from pfcli.systems.localize_lookup.params import Params
from pfcli.systems.localize_lookup.reading_beams import beams_of, model_of
from pfcli.systems.localize_reliable.params import Params as ReliableParams

Cli = Callable[..., "subprocess.CompletedProcess[str]"]
SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
TRUE = np.array([2.4, 2.3, 0.7])
WHEELS = ["--wheel-radius-m", 0.1, "--track-width-m", 0.33]


@pytest.fixture(scope="module")
def map_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("map")
    map_yaml.write(folder, rasterize(WORLDS["four-rooms"](1), 0.05))
    return folder / "map.yaml"


def _assets(map_file: Path, initial: Initial, **given: object) -> tuple[Assets, Params]:
    found = system("localize-lookup")
    params = Params(**given)  # type: ignore[arg-type]
    assets: Assets = filter_of(found).load(params, Job(found, params, [], map=map_file, initial=initial))
    return assets, params


def _seen(assets: Assets, pose: np.ndarray, angles: np.ndarray, mount: np.ndarray) -> np.ndarray:
    """What a perfect sensor reads at a pose."""
    from pfcli.core.grid import raycast

    x = pose[0] + np.cos(pose[2]) * mount[0] - np.sin(pose[2]) * mount[1]
    y = pose[1] + np.sin(pose[2]) * mount[0] + np.cos(pose[2]) * mount[1]
    at = np.array([[(x - assets.grid.origin[0]) / 0.05, (y - assets.grid.origin[1]) / 0.05]])
    turn = pose[2] + mount[2] + angles
    rays = assets.rays
    return raycast.cast_many(rays.room, rays.cells, np.repeat(at, turn.size, 0), turn, 600.0) * 0.05 + 0.025


def _sweep(assets: Assets, pose: np.ndarray) -> Sweep:
    angles = np.radians(np.arange(-120, 120, 2.0))
    mount = np.array([0.12, 0.0, 0.1])
    ranges = _seen(assets, pose, angles, mount).astype(np.float32)
    scan = Scan(5, ranges, float(angles[0]), float(np.radians(2.0)), 0.02, 12.0, Pose2(*mount))
    return Sweep(5, (0.0, 0.0, 0.0), scan, "")


def _sounding(assets: Assets, pose: np.ndarray) -> Sounding:
    mounts = np.array([[0.15, 0.0, 0.5], [0.15, 0.0, -0.5]])
    ranges = np.array([_seen(assets, pose, np.zeros(1), m)[0] for m in mounts], np.float32)
    limits = np.full(2, 0.02, np.float32), np.full(2, 8.0, np.float32)
    return Sounding(5, (0.0, 0.0, 0.0), Ranges(5, ranges, mounts, *limits))


def _off(poses: np.ndarray, pose: np.ndarray) -> np.ndarray:
    turn = np.abs(np.angle(np.exp(1j * (poses[:, 2] - pose[2]))))
    return np.where(turn < 0.2, np.hypot(*(poses - pose)[:, :2].T), np.inf)


def test_one_match_gives_the_heading_at_the_true_place(map_file: Path) -> None:
    """Zhang 2014, eq. (12), in both variants, for a mounted scanner."""
    for variant in ("paper", "corrected"):
        assets, params = _assets(map_file, Initial("inside"), variant=variant)
        beams = beams_of(_sweep(assets, TRUE), params)
        c, s = np.cos(TRUE[2]), np.sin(TRUE[2])
        sensor = np.array([[TRUE[0] + c * 0.12, TRUE[1] + s * 0.12]])
        poses, log_w = smc_start._matched(sensor, beams, 0.1, assets, params, np.random.default_rng(0))
        log_w += evidence(poses, beams, assets, model_of(params, beams, assets, 0.1))
        assert _off(poses[np.argmax(log_w)][None], TRUE)[0] < 0.02


def test_headings_of_several_mounts_are_matched_together(map_file: Path) -> None:
    assets, params = _assets(map_file, Initial("inside"), modes=6)
    beams = beams_of(_sounding(assets, TRUE), params)
    assert beams.mounts.shape == (2, 3)
    c, s = np.cos(TRUE[2]), np.sin(TRUE[2])
    sensor = np.array([[TRUE[0] + c * 0.15, TRUE[1] + s * 0.15]])
    poses, _ = smc_start._matched(sensor, beams, 0.1, assets, params, np.random.default_rng(0))
    assert _off(poses, TRUE).min() < 0.02


@pytest.mark.parametrize("ranges", ["table", "rays"])
def test_the_first_reading_finds_the_robot(map_file: Path, ranges: str) -> None:
    assets, params = _assets(map_file, Initial("inside"), ranges=ranges)
    beams = beams_of(_sweep(assets, TRUE), params)
    found = smc_start.scatter(beams, assets, params, np.random.default_rng(1))
    weights, _ = normalize(found.log_w)
    assert found.pose.shape == (params.particles, 3)
    assert weights[_off(found.pose, TRUE) < 0.3].sum() > 0.8


def test_a_heading_prior_holds(map_file: Path) -> None:
    assets, params = _assets(map_file, Initial("inside", heading=(0.7, 0.05)))
    beams = beams_of(_sounding(assets, TRUE), params)
    found = smc_start.scatter(beams, assets, params, np.random.default_rng(1))
    assert np.abs(np.angle(np.exp(1j * (found.pose[:, 2] - 0.7)))).max() < 0.5


def test_the_evidence_of_a_robot_that_may_be_anywhere_is_the_mean_over_all_poses(map_file: Path) -> None:
    """What `--lost-share` weighs against the particles: log of the mean of p(z | x) over the map."""
    assets, params = _assets(map_file, Initial("inside"))
    beams = beams_of(_sounding(assets, TRUE), params)
    found = smc_start.anywhere(beams, assets, params, np.random.default_rng(3))
    rng = np.random.default_rng(4)
    xy = assets.start_xy[rng.integers(len(assets.start_xy), size=300_000)]
    poses = np.column_stack([xy, rng.uniform(-np.pi, np.pi, len(xy))])
    brute = np.log(np.mean(np.exp(evidence(poses, beams, assets, model_of(params, beams, assets, 0.1)))))
    assert found.log_evidence == pytest.approx(brute, abs=0.25)


def test_a_start_keeps_what_two_range_finders_leave_open(map_file: Path) -> None:
    """The mass where the robot stands is that of all poses, in every seed: hundreds of places fit as well, and one that is
    lost at the start is lost for good."""
    assets, params = _assets(map_file, Initial("inside"))
    beams = beams_of(_sounding(assets, TRUE), params)
    rng = np.random.default_rng(4)
    xy = assets.start_xy[rng.integers(len(assets.start_xy), size=300_000)]
    poses = np.column_stack([xy, rng.uniform(-np.pi, np.pi, len(xy))])
    p = np.exp(evidence(poses, beams, assets, model_of(params, beams, assets, 0.1)))
    expected = p[_off(poses, TRUE) < 0.5].sum() / p.sum()
    masses = []
    for seed in range(10):
        found = smc_start.anywhere(beams, assets, params, np.random.default_rng(seed))
        masses.append(normalize(found.log_w)[0][_off(found.pose, TRUE) < 0.5].sum())
    assert np.std(masses) < 3 * np.sqrt(expected / params.particles)
    assert abs(np.mean(masses) - expected) < 4 * 3 * np.sqrt(expected / params.particles / 10)


def test_equal_rooms_stay_equally_probable(tmp_path: Path) -> None:
    """Four rooms that a scan cannot tell apart: a quarter each, within what 3 500 particles of an SMC sampler scatter (0.06)."""
    map_yaml.write(tmp_path, rasterize(WORLDS["four-rooms-same"](1), 0.05))
    assets, params = _assets(tmp_path / "map.yaml", Initial("inside"), bins=120, start_density_per_m2=0.0)
    alike = [TRUE, TRUE + np.array([6.0, 0.0, 0.0])]
    alike += [np.array([12.0, 10.0, np.pi]) + pose * [-1, -1, 1] for pose in alike]
    beams = beams_of(_sweep(assets, TRUE), params)
    shares = []
    for seed in range(2):
        found = smc_start.anywhere(beams, assets, params, np.random.default_rng(seed))
        weights = normalize(found.log_w)[0]
        shares.append([weights[_off(found.pose, pose) < 0.4].sum() for pose in alike])
    assert np.sum(shares, axis=1) == pytest.approx(1.0, abs=0.1)
    assert (np.abs(np.array(shares) - 0.25) < 0.24).all()  # 4 sigma; drawn at random they are 0 and 1
    assert np.std(shares) < 0.12


def test_shares_of_beams_that_are_more_than_all_are_refused() -> None:
    for name, params in (
        ("localize-lookup", Params(z_hit=0.9, z_short=0.9)),
        ("localize-reliable", ReliableParams(z_hit=0.9, z_rand=0.2)),
    ):
        with pytest.raises(UsageError, match="--z-hit"):
            filter_of(system(name)).load(params, Job(system(name), params, []))


def test_beams_that_bring_nothing_back_are_left_out_unless_asked_for(map_file: Path) -> None:
    assets, params = _assets(map_file, Initial("inside"))
    sweep = _sweep(assets, TRUE)
    ranges = sweep.scan.ranges_m.copy()
    ranges[::4], ranges[1::4] = np.inf, np.nan
    sweep = sweep._replace(scan=sweep.scan._replace(ranges_m=ranges))
    used = beams_of(sweep, params)
    assert np.isfinite(used.range_m).all()
    both = beams_of(sweep, Params(no_return=True))
    assert np.isinf(both.range_m).sum() == 30
    assert not np.isnan(both.range_m).any()


def test_multinomial_offspring_follow_the_weights() -> None:
    weights = np.array([0.5, 0.0, 0.3, 0.2])
    counts = np.zeros(4)
    rng = np.random.default_rng(2)
    for _ in range(500):
        counts += np.bincount(multinomial.ancestors(weights, rng.random(40)), minlength=4)
    n = 500 * 40
    assert (np.abs(counts / n - weights) <= 4.5 * np.sqrt(weights * (1 - weights) / n)).all()


def test_a_table_over_budget_is_replaced_by_rays_and_said_so(map_file: Path) -> None:
    assets, _ = _assets(map_file, Initial("inside"), table_budget_mib=1.0)
    assert assets.table is None
    assert "MiB" in assets.source


def _run(pfcli: Cli, out: Path, *words: object) -> dict[str, object]:
    log, place = SAMPLES / "four-rooms.mcap", SAMPLES / "four-rooms.yaml"
    done = pfcli("localize-lookup", log, "--map", place, "--out", out, "--truth", "auto", "--json", *WHEELS, *words)
    assert done.returncode == 0, done.stderr
    found: dict[str, object] = json.loads(done.stdout)
    return found


def test_the_sample_log_is_localised_with_the_scanner_and_with_two_range_finders(pfcli: Cli, tmp_path: Path) -> None:
    by_scan = _run(pfcli, tmp_path / "a")
    assert by_scan["truth"]["max_m"] < 0.2  # type: ignore[index]
    finders = _run(pfcli, tmp_path / "b", "--topic", "range=/range/left,/range/right", "--seed", 1)
    assert finders["read"]["range"] > 200  # type: ignore[index]
    assert finders["truth"]["median_m"] < 1.0  # type: ignore[index]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--initial", "outside"], "knows no outside"),
        (["--wheel-joints", "a,b"], "has no joint 'a', but left, right"),
        (["--initial", "0.01,0.01,0"], "in a wall"),
        (["--bins", "10"], "bins = 10 is outside 72 .. 720"),
        (["--max-range-m", "0.03"], "usable beam"),
    ],
)
def test_bad_input_is_one_line(words: list[str], told: str, pfcli: Cli, tmp_path: Path) -> None:
    log, place = SAMPLES / "four-rooms.mcap", SAMPLES / "four-rooms.yaml"
    done = pfcli("localize-lookup", log, "--map", place, "--out", tmp_path / "o", *WHEELS, *words)
    assert done.returncode in (1, 2)
    assert told in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "o").exists()


def test_table_builds_inspects_and_checks(pfcli: Cli, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PFCLI_CACHE_DIR", str(tmp_path))
    words = ("table", SAMPLES / "four-rooms.yaml", "--bins", 90, "--check", 20000, "--json")
    first, second = (json.loads(pfcli(*words).stdout) for _ in range(2))
    assert (first["origin"], second["origin"]) == ("built", "kept")
    assert first["within_one_cell"] > 0.7
    changed = json.loads(pfcli("table", SAMPLES / "small-loop.yaml", "--bins", 90, "--json").stdout)
    assert changed["origin"] == "built"


def test_without_a_table_rays_find_the_same_robot(map_file: Path) -> None:
    assets, params = _assets(map_file, Initial("inside"))
    beams = beams_of(_sweep(assets, TRUE), params)
    model = model_of(params, beams, assets, 0.1)
    near = TRUE + np.random.default_rng(0).normal(0, [0.05, 0.05, 0.02], (2000, 3))
    far = TRUE + np.array([1.0, 0.5, 1.0])
    poses = np.vstack([near, far[None]])
    assert assets.table is not None
    looked_up, cast = evidence(poses, beams, assets, model), range_beams.from_rays(poses, beams, assets.rays, model)
    assert looked_up[-1] < looked_up[:-1].min()
    assert np.corrcoef(looked_up, cast)[0, 1] > 0.8


def test_a_heading_prior_weighs_and_a_lost_robot_is_looked_for_in_the_whole_map(map_file: Path) -> None:
    """The prior is part of the weights, not only of the proposal; it and a start region are forgotten by a lost robot."""
    assets, params = _assets(map_file, Initial("inside", heading=(0.7, 0.05)))
    beams = beams_of(_sweep(assets, TRUE), params)
    with_prior = smc_start._matched(TRUE[None, :2], beams, 0.1, assets, params, np.random.default_rng(0))
    plain = smc_start._matched(
        TRUE[None, :2], beams, 0.1, assets._replace(initial=Initial("inside")), params, np.random.default_rng(0)
    )
    best = np.argmax(with_prior[1])
    off = np.abs(np.angle(np.exp(1j * (with_prior[0][:, 2] - 0.7))))
    assert off[best] < 0.1
    assert (with_prior[1][off > 0.5] < plain[1].max() - 30.0).all()
    assert assets.free_xy.shape[0] >= assets.start_xy.shape[0]
