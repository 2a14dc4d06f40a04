"""The filter: proposal, weights, resampling, and what must survive a broken part."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from pfcli.core.evaluation import map_quality, se2, track_error
from pfcli.core.geometry import between, compose
from pfcli.core.graph.pose_graph import Relaxed, no_edges, softened
from pfcli.core.grid import tiles
from pfcli.core.grid.scan_odometry import Setup
from pfcli.core.grid.scan_points import beams_of, points_of
from pfcli.params import build
from pfcli.registry import system
from pfcli.replay.log import Log
from pfcli.replay.settings import Settings
from pfcli.runs import loop
from pfcli.simulation.laser import cast
from pfcli.systems.shared.contract import Frame
from pfcli.systems.slam_gdr import matching, path_smoother
from pfcli.systems.slam_gdr.filter import _moved
from pfcli.systems.slam_gdr.params import Params
from pfcli.systems.slam_gdr.proposal_kernels import coalesced, covariance, sample_proposal, trace
from pfcli.systems.slam_gdr.scan_chain import chained
from tests.conftest import SAMPLES

SLAM = system("slam-gdr")


def _job(seed: int = 0, end_s: float | None = None, smooth: bool = False, **params: object) -> loop.Job:
    params["smooth"] = smooth
    log = SAMPLES / "small-loop.mcap"
    return loop.Job(SLAM, build(SLAM.params, params, "test"), [log], seed, Settings(end_s=end_s), truth="auto")


def test_the_proposal_has_the_covariance_of_the_match() -> None:
    rng = np.random.default_rng(0)
    n = 100_000
    cov = np.array([[0.04, 0.01, 0.002], [0.01, 0.03, -0.001], [0.002, -0.001, 0.005]])
    info = np.broadcast_to(np.linalg.inv(cov), (n, 3, 3)).copy()
    poses, half_log_det, _ = sample_proposal(np.zeros((n, 3)), info, 0.5, rng.standard_normal((n, 3)))
    # standard error of a covariance entry: sqrt((c_ii c_jj + c_ij^2) / n)
    error = np.sqrt((np.outer(np.diag(cov), np.diag(cov)) + cov**2) / n)
    assert (np.abs(np.cov(poses.T) / 0.25 - cov) < 5 * error).all()
    assert half_log_det[0] == pytest.approx(0.5 * np.log(np.linalg.det(cov)))


def test_ancestry_is_traced_and_its_common_part_counted() -> None:
    parents = np.array([[0, 1, 2], [0, 0, 2], [1, 1, 2], [0, 1, 1]])
    assert trace(parents, 2).tolist() == [0, 1, 1, 2]
    assert coalesced(np.array([[0, 1], [0, 0], [0, 1]])) == 1
    assert coalesced(np.array([[0, 1], [0, 1]])) == 0


@pytest.mark.parametrize("n", [1, 5])
def test_the_past_that_all_share_is_kept_once_and_as_it_was(n: int) -> None:
    """Against the whole history of every particle, for particles that die out at random."""
    from pfcli.events import Pose2, Scan, Sweep
    from pfcli.systems.slam_gdr.ancestry import History

    rng, updates = np.random.default_rng(4), 400
    kept, poses, parents = History(), [], []
    for k in range(updates):
        scan = Scan(k, np.ones(1, np.float32), 0.0, 0.1, 0.0, 9.0, Pose2())
        kept.see(Sweep(k, (0.0, 0.0, 0.0), scan, ""))
        poses.append(rng.standard_normal((n, 3)))
        parents.append(np.sort(rng.integers(0, n, n)) if k % 7 == 3 else np.arange(n))
        kept.update(poses[-1], parents[-1], np.eye(3))
    for best in range(n):
        line = trace(np.array(parents), best)
        wanted = np.array([p[i] for p, i in zip(poses, line, strict=True)])
        assert np.allclose(kept.track(kept.path(best), kept.covariance()).poses[:, :2], wanted[:, :2])
    assert kept.shared() == coalesced(np.array(parents))
    assert len(kept._poses) < 150


def test_covariance_of_headings_near_the_seam() -> None:
    poses = np.array([[0.0, 0, 3.13], [0.0, 0, -3.13]])
    assert covariance(poses)[2, 2] == pytest.approx((np.pi - 3.13) ** 2)


def test_weights_do_not_change_sharpness_with_the_number_of_particles() -> None:
    """The evidence of an update is a property of scan and map; its spread over particles must not depend on N."""
    shares = []
    for n in (10, 40):
        infos = loop.execute(_job(end_s=40, particles=n, resampler="systematic", resample_threshold=0.0)).infos
        shares.append(np.mean([i.n_eff / n for i in infos[-20:]]))
    assert shares[1] == pytest.approx(shares[0], rel=0.35)


@pytest.mark.parametrize("resampler", ["gdr", "csw", "systematic", "stratified"])
@pytest.mark.parametrize("variant", ["paper", "corrected"])
def test_every_resampler_and_variant_maps_the_loop(resampler: str, variant: str) -> None:
    done = loop.execute(_job(end_s=60, particles=8, resampler=resampler, variant=variant, evidence_gain=0.1))
    assert done.errors is not None
    assert done.errors.summary()["ate_m"] < 0.05
    spread = max(i.offspring_spread_m for i in done.infos)
    assert (spread > 0) == (resampler == "gdr" and any(i.resampled for i in done.infos))


def test_every_scan_has_a_pose_and_updates_are_marked() -> None:
    done = loop.execute(_job(end_s=30))
    track = done.result.track
    assert track.stamps_ns.size == done.dropped.read["scan"]
    assert track.columns["update"].sum() == len(done.infos)
    assert np.isfinite(track.poses).all()


def test_a_filter_that_ignores_its_scans_is_far_off() -> None:
    """The figures that the golden test compares do tell a broken filter: without matching the error is tens of times larger."""
    good, blind = (loop.execute(job).errors for job in (_job(), _blind()))
    assert good is not None
    assert blind is not None
    assert blind.summary()["ate_m"] > 5 * good.summary()["ate_m"]


def _blind() -> loop.Job:
    return _job(beam_gain=1e-4, rescue_inliers=0.0, coarse_xy_m=0.01, coarse_yaw_deg=0.5)


def test_memory_is_flat_when_the_same_place_is_driven_twice() -> None:
    """The second lap of the sample adds few tiles to those of the first."""
    infos = loop.execute(_job()).infos
    half = len(infos) // 2
    assert infos[-1].tiles < 1.5 * infos[half].tiles


def test_one_particle_works() -> None:
    done = loop.execute(_job(end_s=40, particles=1))
    assert done.errors is not None
    assert done.errors.summary()["ate_m"] < 0.05


class _Handed(NamedTuple):
    scans: list[tiles.Beams]
    steps_at: Callable[[float], np.ndarray]
    given: np.ndarray
    setup: Setup


@pytest.fixture(scope="module")
def smoothed() -> tuple[loop.Run, _Handed]:
    """A run with --smooth, and what it handed to the smoother."""
    kept: list[_Handed] = []
    whole = path_smoother.smooth

    def watched(*handed: Any) -> path_smoother.Smoothed:
        kept.append(_Handed(*handed))
        return whole(*handed)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(path_smoother, "smooth", watched)
        done = loop.execute(_job(seed=1, smooth=True))
    return done, kept[0]


def test_smoothing_finds_the_places_again_and_the_odometry_true(smoothed: Any) -> None:
    """The sample's wheels drift by chance and not in scale (`docs/formats.md`); the filter alone has 0.015 m."""
    done, _ = smoothed
    summary = done.result.summary
    assert summary["smoothed"]
    assert summary["closures_used"] >= 0.9 * summary["closures"] >= 20
    assert abs(summary["odometry_way"]) < 0.005
    assert done.errors is not None
    assert done.errors.summary()["ate_m"] < 0.006
    # the map is drawn anew
    plain = loop.execute(_job(seed=1))
    assert done.result.grid is not None
    assert plain.result.grid is not None
    assert map_quality.doubled_walls(done.result.grid) <= map_quality.doubled_walls(plain.result.grid) + 0.02


def test_frames_move_with_the_poses_of_their_updates() -> None:
    stamps, before = np.array([10, 20, 30]), np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    after = np.array([[0.0, 0, 0], [0.0, 1, np.pi / 2], [0.0, 2, np.pi / 2]])
    around = np.array([[2.0, 0.1, 0.0], [2.3, 0.0, 0.2]])
    frame = Frame(30, np.array([2.1, 0.0, 0.0]), around, np.zeros(2, np.uint8), np.zeros((1, 2)))
    (moved,) = _moved([frame], stamps, before, after)
    assert np.allclose(moved.pose, [0.0, 2.1, np.pi / 2])
    assert np.allclose(moved.particles, [[-0.1, 2.0, np.pi / 2], [0.0, 2.3, np.pi / 2 + 0.2]])


def test_odometry_that_comes_late_is_found_out(smoothed: Any) -> None:
    """The sample's odometry is in time; here it is half a second late, and 0.01 rad a metre wrong."""
    done, handed = smoothed
    straight = done.result.track.poses[done.result.track.columns["update"]]
    assert done.result.summary["odometry_later_s"] == 0.0

    def late(offset_s: float) -> np.ndarray:
        steps = handed.steps_at(offset_s - 0.5).copy()
        steps[:, 2] += 0.01 * np.hypot(steps[:, 0], steps[:, 1])
        return steps

    found = path_smoother.smooth(*handed._replace(steps_at=late))
    assert found.offset_s == pytest.approx(0.5, abs=0.05)
    moved = se2.compose(track_error.align_se2(found.path.poses, straight)[None], found.path.poses)
    assert float(np.hypot(*(moved - straight)[:, :2].T).max()) < 0.03


def test_closures_that_contradict_each_other_make_a_run_doubtful(smoothed: Any) -> None:
    """Nine in ten agree: no finding; eight in ten: doubt."""
    none = no_edges()
    for outvoted, codes in ((3, []), (8, ["slam-gdr:W1"])):
        weights = np.array([0.0] * outvoted + [1.0] * (40 - outvoted))
        closures = none._replace(first=np.zeros(40, np.int64), second=np.ones(40, np.int64))
        found = path_smoother.Smoothed(
            path=Relaxed(np.zeros((2, 3)), np.zeros((0, 2, 3)), weights),
            fits=np.ones(2, bool),
            closures=closures,
            weights=weights,
            doubted=none,
            loops=0,
            offset_s=0.0,
            calibration=None,
        )
        assert [f.code for f in found.dropped().findings()] == codes
    assert not smoothed[0].findings


def test_each_closure_is_told_and_why_it_does_not_count(smoothed: Any) -> None:
    done, _ = smoothed
    table, summary = done.result.tables["closures"], done.result.summary
    count = summary["closures"] + sum(w == "no match near it agrees" for w in table["why_not"])
    assert len(table["used"]) == count
    assert sum(table["used"]) == summary["closures_used"]
    assert all(used == (why == "") for used, why in zip(table["used"], table["why_not"], strict=True))
    assert (table["second_t_ns"] > table["first_t_ns"]).all()


def test_smoothed_covariances_say_how_far_off_the_track_is(smoothed: Any) -> None:
    """Against truth, seen from the first pose: not overconfident by more than a factor of two, and not useless."""
    done, handed = smoothed
    columns = done.result.track.columns
    at = columns["update"]
    sd = np.sqrt(columns["cov_xx_m2"][at] + columns["cov_yy_m2"][at])
    assert len(sd) == len(handed.scans)
    assert sd[0] == 0.0
    truth = list(Log(SAMPLES / "small-loop.mcap").events(["truth"]))
    there = track_error.interpolate(
        done.result.track.stamps_ns[at], np.array([e.stamp_ns for e in truth]), np.array([e[1:4] for e in truth])
    )
    known = np.isfinite(there[:, 0])
    mine = between(done.result.track.poses[at][known][:1], done.result.track.poses[at][known])
    off = np.hypot(*(mine - between(there[known][:1], there[known]))[:, :2].T)
    ratio = np.sqrt((off**2).mean()) / np.sqrt((sd[known] ** 2).mean())
    assert 0.1 < ratio < 2


def test_the_graph_is_told_along_and_across_the_way_whatever_the_heading() -> None:
    """In a plain corridor a scan says nothing along the way; odometry, which says it, is worth 1 / (0.07 m)^2."""
    bearings = np.radians(np.arange(-90.0, 90.5))
    walls = np.array([[-100.0, -1.2, 100.0, -1.2], [-100.0, 1.3, 100.0, 1.3]])
    seen = np.empty(bearings.size)
    setup = matching.setup(Params(sigma_hit_m=0.03, resolution_m=0.05))
    setup = setup._replace(matcher=setup.matcher._replace(map_normals=True, tangent=0.0))
    for heading in (0.0, np.pi / 2):
        scans, at = [], np.zeros(3)
        # the chain begins along its x axis: the robot first turns on the spot, in a corridor that lies across
        turns = [np.array([0.0, 0.0, heading / 6])] * (6 if heading else 0)
        for step in (None, *turns, *([np.array([0.25, 0.0, 0.0])] * 40)):
            if step is not None:
                at = compose(at[None], step[None])[0]
            x, y, yaw = (at[1], -at[0], at[2] - heading) if heading else at
            cast(x, y, bearings + yaw, walls, np.zeros((0, 3)), 80.0, seen)
            ends = points_of(seen, (bearings[0], np.radians(1)), (0.0, 30.0), (0.0, 0.0, 0.0), 1, 0.0, 0.05)
            scans.append(beams_of(ends, (0.0, 0.0, 0.0)))
        steps = np.array([*turns, *([np.array([0.25, 0.0, 0.0])] * 40)])
        chain = chained(scans, steps, setup.noise, setup, np.ones(len(steps), bool))
        assert abs(chain.poses[-1, 2] - heading) < 0.01
        along, across = np.median(chain.edges.information[-20:, [0, 1], [0, 1]], axis=0)
        assert 100 < along < 3000 < 10_000 < across


def test_what_a_match_does_not_tell_stays_untold() -> None:
    """Along a plain wall, at any angle to the axes, and where a little less than nothing is left of it."""
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1.0]])
    for along in (0.0, -5.0):
        told = softened((turn @ np.diag([along, 1e4, 1e5]) @ turn.T)[None], (0.02, 0.02, 0.003))[0]
        assert np.linalg.eigvalsh(told).min() > 0
        expected = turn @ np.diag([1e-3, 1 / (1e-4 + 0.0004), 1 / (1e-5 + 9e-6)]) @ turn.T
        assert np.allclose(told, expected, rtol=1e-3, atol=1e-2)
    assert softened(np.zeros((0, 3, 3)), (1.0, 1.0, 1.0)).shape == (0, 3, 3)


def test_smoothing_needs_no_second_update() -> None:
    done = loop.execute(_job(end_s=0.3, smooth=True))
    assert done.result.summary["closures"] == 0
    assert np.isfinite(done.result.track.poses).all()
