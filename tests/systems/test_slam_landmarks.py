"""slam-gdr --landmarks: tracks and landmarks of a simulated car, the smoother against its optimum, and known landmarks."""

import json
import math
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfcli.core.geometry import between, compose
from pfcli.dropped import Dropped
from pfcli.errors import LogError
from pfcli.events import Landmarks, Odometry
from pfcli.formats import landmark_csv, landmark_logs
from pfcli.formats.log_writer import LogWriter
from pfcli.registry import system
from pfcli.replay import vision
from pfcli.runs import loop
from pfcli.simulation import landmark_world as simulated
from pfcli.systems.slam_landmarks import (
    landmark_merging,
    landmark_smoother,
    landmark_start,
    sensor_calibration,
    whole_log_association,
)
from pfcli.systems.slam_landmarks.landmark_problem import ALL, Log, Options, pattern_of, rows_of
from pfcli.systems.slam_landmarks.motion_spread import motion_spread
from pfcli.systems.slam_landmarks.observation_kernels import UNKNOWN
from pfcli.systems.slam_landmarks.params import Params

SLAM = system("slam-gdr-landmarks")
WORLD = simulated.SCENARIOS["landmarks-sample"]._replace(laps=1)
Cli = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("landmarks") / "log.mcap"
    simulated.write(WORLD, 3, path)
    simulated.write_map(WORLD, path.parent, "log")
    return path


def played(log: Path, seed: int = 0, **given: Any) -> loop.Run:
    params: dict[str, Any] = simulated.NOISE | {"rejuvenate_steps": 25} | given  # seldom, for speed
    return loop.execute(loop.Job(SLAM, Params(**params), [log], seed, truth="auto"))


def off(ran: loop.Run) -> float:
    """RMSE of the positions without alignment: the start is known."""
    truth = [now.truth for now in simulated.play(WORLD, 3) if now.seen is not None and now.seen.size]
    return float(np.sqrt(np.mean(np.square(ran.result.track.poses[:, :2] - np.array(truth)[:, :2]).sum(axis=1))))


@pytest.mark.parametrize("given", [{}, {"rejuvenate_steps": 0}, {"association": "unknown"}, {"proposal": "fastslam1"}])
def test_a_lap_is_tracked_and_all_landmarks_in_range_are_found(log: Path, given: dict[str, Any]) -> None:
    ran = played(log, **given)
    seen = {int(i) for now in simulated.play(WORLD, 3) if now.seen is not None for i in now.seen.tolist()}
    assert off(ran) < 1.0
    assert abs(ran.result.summary["landmarks"] - len(seen)) <= (4 if given.get("association") == "unknown" else 0)


def test_what_is_not_known_of_the_pose_is_said(log: Path) -> None:
    """Normalised squared errors average 2. Those of one drive hang together and leave room to both sides; particles that were
    resampled to a few ancestors, and nothing else, say 9-15 here, and hundreds on longer drives."""
    ran = played(log)
    assert ran.errors is not None
    nees = ran.errors.normalised(ran.result.track.columns)
    assert nees is not None
    assert 0.05 < np.nanmean(nees[25:]) < 4.0


def test_the_smoothed_track_is_better_and_known_landmarks_are_better_still(log: Path) -> None:
    rough, smoothed = off(played(log, rejuvenate_steps=0)), off(played(log, smooth=True))
    known = played(log, landmark_map=str(log.with_name("log-landmarks.csv")))
    assert smoothed < max(0.25, 0.8 * rough)
    assert known.errors is not None
    assert np.sqrt(np.mean(known.errors.position_m**2)) < 0.1


def test_landmarks_are_where_they_are_within_what_their_covariance_allows(log: Path) -> None:
    """Known poses would give each landmark to a centimetre; the drive's own error comes on top: three sigma and 0.5 m."""
    table = played(log, smooth=True).result.tables["landmarks"]
    marks, _ = simulated.places(WORLD)
    d = np.hypot(
        table["x_m"] - marks[[int(i) for i in table["id"]], 0], table["y_m"] - marks[[int(i) for i in table["id"]], 1]
    )
    sigma = np.sqrt(table["cov_xx_m2"] + table["cov_yy_m2"])
    assert (d < 3 * sigma + 0.5).all()
    assert np.median(d) < 0.25


def problem(seed: int) -> tuple[Log, np.ndarray, np.ndarray]:
    """Ten poses and three landmarks, measured with noise."""
    rng = np.random.default_rng(seed)
    marks = np.array([[3.0, 2.0], [5.0, -2.0], [8.0, 3.0]])
    track = [np.zeros(3)]
    for _ in range(9):
        track.append(compose(track[-1][None], np.array([[0.7, 0.0, 0.1]]))[0])
    true = np.array(track)
    step = between(true[:-1], true[1:]) + rng.normal(0, (0.05, 0.05, 0.02), (9, 3))
    step[:, 1] += 0.3 * (step[:, 2] - between(true[:-1], true[1:])[:, 2])
    at, of = np.repeat(np.arange(10), 3), np.tile(np.arange(3), 10)
    d = marks[of] - true[at, :2]
    z = np.column_stack([np.hypot(*d.T), np.arctan2(d[:, 1], d[:, 0]) - true[at, 2]]) + rng.normal(
        0, (0.05, 0.01), (30, 2)
    )
    z[:, 1] = np.remainder(z[:, 1] + np.pi, 2 * np.pi) - np.pi
    return (
        Log(
            step=step,
            step_sd=np.tile([0.05, 0.05, 0.02, 0.3], (9, 1)),
            at=at,
            of=of,
            z=z,
            sd=np.tile([0.05, 0.01], (30, 1)),
        ),
        true,
        marks,
    )


def test_the_smoother_finds_the_optimum_of_a_general_solver() -> None:
    from scipy.optimize import minimize

    log, true, marks = problem(0)
    found = landmark_smoother.solve(log, true, marks)

    def cost(p: np.ndarray) -> float:
        track = np.vstack([true[:1], p[:27].reshape(9, 3)])
        return landmark_smoother._cost(track, p[27:].reshape(3, 2), sensor_calibration.none(), log)

    start = np.concatenate([true[1:].ravel(), marks.ravel()])
    best = minimize(cost, start, method="L-BFGS-B", options={"maxiter": 2000, "maxfun": 200_000}).fun
    assert found.cost <= best + 1e-2


@pytest.mark.parametrize("fixed", [False, True])
def test_scales_are_found_where_landmarks_tell_them(fixed: bool) -> None:
    """Ranges 4 % too long and turns 8 % too far. Known landmarks tell both; unknown ones only turns, for a longer range and a
    longer way look the same."""
    log, true, marks = problem(1)
    log = log._replace(z=log.z * [1.04, 1.0], step=log.step * [1.0, 1.0, 1.08])
    options = Options(fixed=fixed, learnt=ALL)
    found = landmark_smoother.solve(log, true, marks, None, options)
    plain = landmark_smoother.solve(log, true, marks, None, Options(fixed=fixed))
    assert found.cost <= plain.cost
    assert found.calibration[5] == pytest.approx(0.08, abs=0.05)
    if fixed:
        assert found.calibration[0] == pytest.approx(0.04, abs=0.01)
    seen, step = sensor_calibration.corrected(log.z, log.step, np.array([0.04, 0.0, 0.0, 0.0, 0.0, 0.08]))
    assert np.allclose(seen[:, 0] * 1.04, log.z[:, 0])
    off = landmark_smoother.solve(log._replace(z=log.z + np.array([0.0, 0.02])), true, marks, None, options)
    if fixed:
        # 30 bearings of 0.01 rad each, and the heading of ten poses that share it
        assert off.calibration[3] - found.calibration[3] == pytest.approx(0.02, abs=0.01)
    assert np.allclose(step[:, 2] * 1.08, log.step[:, 2])


@pytest.mark.parametrize(
    "options",
    [Options(), Options(True, ALL), Options(False, ALL)],
)
def test_jacobians_of_the_smoother_are_the_differences(options: Options) -> None:
    log, track, marks = problem(3)
    now = track, marks, np.array([0.02, -0.03, 0.01, 0.02, 0.04, 0.05])
    pattern = pattern_of(log, 3, options)
    size = log.step.shape[0], log.at.size

    def residual(move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, out = np.empty(24 * size[0] + 18 * size[1]), np.empty(3 * size[0] + 2 * size[1])
        rows_of(*landmark_smoother._moved(now, move, pattern), tuple(log), value, out, 0.0)
        return out, value

    base, value = residual(np.zeros(pattern.size))
    jacobian = np.zeros((base.size, pattern.size))
    np.add.at(jacobian, (pattern.rows, pattern.columns), value[pattern.counts])
    for k in range(pattern.size):
        step = np.zeros(pattern.size)
        step[k] = 1e-6
        ahead, back = residual(step)[0], residual(-step)[0]
        assert np.allclose((ahead - back) / 2e-6, jacobian[:, k], atol=1e-4, rtol=1e-5), k


@pytest.mark.parametrize("pivot_m", [0.0, 4.0])
def test_two_short_steps_are_as_uncertain_as_a_long_one(pivot_m: float) -> None:
    """Covariances of along, across and yaw; what was turned in the first step moves the second across."""
    params = Params(motion_xy_m=1e-6, motion_yaw_rad=1e-6, motion_pivot_m=pivot_m)

    def cov(way: float) -> np.ndarray:
        along, across, yaw, behind = motion_spread(way, 0.0, params)
        own = np.diag(np.square([along, across, yaw]))
        lever = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, behind], [0.0, 0.0, 1.0]])
        return lever @ own @ lever.T

    # the axle behind goes the same way: what counts is how far the second step carries its pose
    carried = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 3.0], [0.0, 0.0, 1.0]])
    assert np.allclose(carried @ cov(3.0) @ carried.T + cov(3.0), cov(6.0), rtol=1e-6, atol=1e-9)


def replayed(tmp_path: Path, frames: list[list[tuple[str, float, float]]], **given: Any) -> loop.Run:
    """A robot that stands still; frames: id, range and bearing of what it sees each 0.2 s."""
    path = tmp_path / "still.mcap"
    with LogWriter(path) as out:
        for k, frame in enumerate(frames):
            stamp = 10**18 + k * 200_000_000
            out.event(Odometry(stamp, 0.0, 0.0, 0.0))
            ids, ranges, bearings = zip(*frame, strict=True) if frame else ((), (), ())
            unknown = np.full((len(frame), 2), np.nan)
            out.event(Landmarks(stamp, tuple(ids), np.array(ranges), np.array(bearings), unknown))
    return loop.execute(loop.Job(SLAM, Params(**given), [path]))


def test_what_cannot_be_is_left_out_counted_and_named(tmp_path: Path) -> None:
    good = [("a", 2.0, 0.1), ("b", 3.0, -0.4)]
    twice = replayed(tmp_path, [good, [*good, ("a", 5.0, 1.0)], good])
    assert twice.dropped.counts == {"landmark twice at a stamp": 1}
    assert "'a'" in twice.dropped.notes[0]
    below = replayed(tmp_path, [good, [("a", -2.0, 0.1), ("b", 3.0, -0.4)], good])
    assert below.dropped.counts == {"point that is not a number": 1}
    assert np.abs(below.result.track.poses).max() < 0.05
    once = replayed(tmp_path, [[("a", 2.0, 0.1)], [("b", 3.0, -0.4)]])
    assert once.dropped.counts == {"landmarks seen once": 1}


@pytest.mark.parametrize("steps", [1, 3, 10])
def test_particles_drawn_anew_remember_what_speaks_against_a_landmark(tmp_path: Path, steps: int) -> None:
    """A first observation of a single landmark, one that is dropped as the particles are drawn anew, and one that is seen a few
    times and then missed for long."""
    replayed(tmp_path, [[("a", 5.0, 0.0)], [("a", 5.0, 0.0)]], rejuvenate_steps=steps)
    given = {"association": "unknown", "spurious_m": 10.0, "rejuvenate_steps": steps, "particles": 5}
    replayed(tmp_path, [[("", 5.0, 0.0)], [("", 5.45, 0.0)], [("", 5.45, 0.0)]], **given)
    still = [("", 4.0, 0.5), ("", 6.0, -0.6)]
    ran = replayed(tmp_path, [[*still, ("", 3.0, 0.0)]] * 8 + [still] * 60, **given)
    assert ran.result.summary["landmarks"] == 2


def test_a_landmark_that_moves_is_named_and_does_not_carry_the_robot_away(tmp_path: Path) -> None:
    still = [("a", 2.0, 0.1), ("b", 3.0, -0.4), ("c", 4.0, 0.9)]
    ran = replayed(tmp_path, [[*still, ("walker", 2.0 + 0.2 * k, 0.6 - 0.05 * k)] for k in range(25)])
    assert ran.dropped.counts == {"landmark that moves": 1}
    assert "'walker'" in ran.dropped.notes[0]
    assert np.abs(ran.result.track.poses[:, :2]).max() < 0.15


def test_landmarks_that_the_map_does_not_know_are_counted(tmp_path: Path) -> None:
    marks = tmp_path / "map.csv"
    marks.write_text("id,x_m,y_m\na,2.0,0.2\nb,2.8,-1.2\n")
    frame = [("a", 2.01, 0.0997), ("b", 3.046, -0.4049), ("new", 1.0, 0.0)]
    ran = replayed(tmp_path, [frame] * 3, landmark_map=str(marks))
    assert ran.dropped.read["detections of landmarks that the map does not know"] == 3
    assert np.abs(ran.result.track.poses).max() < 0.1


def test_depths_are_distances_by_the_bearing(tmp_path: Path) -> None:
    event = Landmarks(0, ("a", "b", "c"), np.array([2.0, 2.0, 2.0]), np.array([0.0, 0.5, 1.5]), np.full((3, 2), np.nan))
    dropped = Dropped()
    seen = vision.distances(event, "x", dropped)
    assert seen.ids == ("a", "b")
    assert np.allclose(seen.range_m * np.cos(seen.bearing_rad), 2.0)
    assert dropped.counts == {"depth aside": 1}


def test_a_start_waits_until_what_was_seen_tells_it(tmp_path: Path) -> None:
    """Two landmarks side by side far ahead say little of the heading; a third, aside, does."""
    marks = tmp_path / "map.csv"
    marks.write_text("id,x_m,y_m\na,6.0,0.1\nb,6.0,-0.1\nc,0.0,3.0\n")
    poor = [("a", 6.0, 0.0167), ("b", 6.0, -0.0167)]
    ran = replayed(tmp_path, [poor] * 3 + [[*poor, ("c", 3.0, 1.5708)]] * 3, landmark_map=str(marks))
    assert ran.result.track.stamps_ns.size == 3
    assert np.abs(ran.result.track.poses).max() < 0.1


def test_the_covariance_matches_the_errors(log: Path) -> None:
    """NEES of the smoothed positions: 2 if errors of one drive were independent; a drive has few independent ones."""
    ran = played(log, smooth=True)
    assert ran.errors is not None
    assert ran.errors.nees is not None
    assert 0.05 < np.nanmean(ran.errors.nees) < 8.0


def test_draws_of_the_track_have_the_spread_of_its_errors() -> None:
    """The last pose of many problems: its normalised squared error averages 3 (the robust cost and curvature allow 2-4.5)."""
    squares = []
    for seed in range(60):
        log, true, marks = problem(seed)
        found = landmark_smoother.solve(log, true, marks, draws=200, rng=np.random.default_rng(seed))
        cov = np.cov(found.draws[:, -1].T)
        assert np.diag(cov) == pytest.approx(np.diag(found.end_cov), rel=5 * math.sqrt(2 / 100))
        e = found.track[-1] - true[-1]
        squares.append(e @ np.linalg.solve(cov, e))
    assert 2.0 < np.mean(squares) < 4.5


def test_the_command_writes_landmarks_and_names_flags_of_the_other_half(pfcli: Cli, log: Path, tmp_path: Path) -> None:
    done = pfcli("slam-gdr", log, "--landmarks", "--out", tmp_path / "a", "--end", 10, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["landmarks"] > 3
    assert landmark_csv.read(tmp_path / "a/landmarks.csv")
    wrong = pfcli("slam-gdr", log, "--landmarks", "--resolution-m", 0.1, "--out", tmp_path / "b")
    assert (wrong.returncode, wrong.stderr.count("\n")) == (2, 1)
    assert "--resolution-m goes without --landmarks" in wrong.stderr
    wrong = pfcli("slam-gdr", log, "--association", "known", "--out", tmp_path / "b")
    assert "--association goes with --landmarks" in wrong.stderr


@pytest.mark.parametrize(
    "text", ["", "a,b\n1,2\n", "id,x_m,y_m\n1,2,x\n", "id,x_m,y_m\n1,2,3\n1,2,3\n", "id,x_m,y_m\n1,nan,3\n"]
)
def test_a_landmark_map_that_is_none_is_one_line(text: str, tmp_path: Path) -> None:
    path = tmp_path / "map.csv"
    path.write_text(text)
    with pytest.raises(LogError, match=r"map\.csv") as caught:
        landmark_csv.read(path)
    assert "\n" not in str(caught.value)


def test_mrclam_maps_barcodes_and_leaves_robots_and_unknown_codes_out(tmp_path: Path) -> None:
    files = {
        "Barcodes.dat": "# c\n1 5\n6 63\n",
        "Landmark_Groundtruth.dat": "6 1.5 -2.0 0 0\n",
        "Robot1_Odometry.dat": "10.0 0.1 0.2\n10.1 0.1 0.2\n",
        "Robot1_Groundtruth.dat": "10.0 1 2 0.5\n",
        "Robot1_Measurement.dat": "10.05 63 2.0 0.1\n10.05 5 2.0 0.1\n10.05 99 2.0 0.1\nx y\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    reader = landmark_logs.reader_of(tmp_path / "Robot1_Measurement.dat")
    assert reader is not None
    found = reader(tmp_path / "Robot1_Measurement.dat")
    seen = [e for e in found.events if isinstance(e, landmark_logs.Landmarks)]
    assert [e.ids for e in seen] == [("6",)]
    assert (found.robots, found.unknown, found.broken) == (1, 1, 1)
    assert found.places == {"6": (1.5, -2.0)}
    (tmp_path / "Barcodes.dat").unlink()
    with pytest.raises(LogError, match=r"Barcodes\.dat"):
        reader(tmp_path / "Robot1_Measurement.dat")


def test_the_lectures_world_is_read_as_odometry_and_detections(tmp_path: Path) -> None:
    (tmp_path / "world.dat").write_text("1 2 1\n")
    (tmp_path / "sensor_data.dat").write_text(
        "ODOMETRY 0 1 0\nSENSOR 1 1.4 0.7\nODOMETRY 1.5707963 1 0\nSENSOR 1 1 0\n"
    )
    found = landmark_logs.stachniss(tmp_path / "sensor_data.dat")
    last = [e for e in found.events if isinstance(e, landmark_logs.Odometry)][-1]
    assert (last.x_m, last.y_m) == pytest.approx((1.0, 1.0), abs=1e-6)
    assert last.yaw_rad == pytest.approx(math.pi / 2, abs=1e-6)


def test_a_start_that_fits_two_places_waits() -> None:
    """Three landmarks that stand twice in the map, and with a fourth one beside one of them."""
    one = np.array([[0.0, 0.0], [2.0, 0.5], [1.0, 3.0]])
    shapes = np.concatenate([one, one + np.array([20.0, 5.0])])
    known = {str(k): (float(x), float(y)) for k, (x, y) in enumerate(shapes)}
    robot = np.array([1.0, -2.0])

    def start(points: np.ndarray, places: dict[str, tuple[float, float]]) -> np.ndarray | None:
        unknown = np.full(len(points), UNKNOWN, np.int32)
        seen = landmark_start.Seen(np.zeros((1, 3)), points - robot, np.full(len(points), 0.05), unknown)
        return landmark_start.placed((seen,), places, Params(false_share=0.02), np.random.default_rng(0))

    assert start(one, known) is None
    found = start(np.concatenate([one, [[-1.0, 1.0]]]), known | {"own": (-1.0, 1.0)})
    assert found is not None
    # the spread of a mean of four points of 0.05 m each
    assert np.allclose(found[:, :2].mean(axis=0), robot, atol=0.15)


def _joint(sd_each: float, sd_common: float) -> np.ndarray:
    """Covariance of four landmarks: the last two share an error of the odometry."""
    cov = sd_each**2 * np.eye(8)
    shared = np.tile(np.eye(2), (2, 2))
    cov[4:, 4:] += sd_common**2 * shared
    return cov


def test_pairs_that_only_fit_together_are_merged() -> None:
    """A second visit two metres off: each landmark alone fits neither place well, both together fit one way only."""
    first = np.array([[0.0, 0.0], [3.0, 1.0]])
    mean = np.concatenate([first, first + np.array([1.5, -1.0])])
    alone = landmark_merging.same(landmark_merging.Landmarks(mean, _joint(0.05, 1.5), np.zeros((4, 4), np.int64)))
    assert alone.tolist() in ([0, 1, 0, 1], [0, 1, 0, 2], [0, 1, 2, 1])
    sure = landmark_merging.same(landmark_merging.Landmarks(mean, _joint(0.05, 0.05), np.zeros((4, 4), np.int64)))
    assert sure.tolist() == [0, 1, 2, 3]


def test_landmarks_of_one_image_are_two() -> None:
    mean, together = np.array([[0.0, 0.0], [0.05, 0.0]]), np.array([[0, 1], [1, 0]])
    cov = 0.1**2 * np.eye(4)
    assert landmark_merging.same(landmark_merging.Landmarks(mean, cov, 0 * together)).tolist() == [0, 0]
    assert landmark_merging.same(landmark_merging.Landmarks(mean, cov, together)).tolist() == [0, 1]


def test_an_equality_moves_the_other_landmarks_as_a_kalman_update_does() -> None:
    rng = np.random.default_rng(2)
    mean, root = rng.normal(size=(4, 2)), rng.normal(size=(8, 8))
    cov = root @ root.T
    found, into = landmark_merging._joined(landmark_merging.Landmarks(mean, cov, np.zeros((4, 4), np.int64)), 0, 2)
    h = np.kron([[1.0, 0.0, -1.0, 0.0]], np.eye(2))
    gain = cov @ h.T @ np.linalg.inv(h @ cov @ h.T)
    whole = (mean.ravel() - gain @ h @ mean.ravel()).reshape(4, 2)
    assert into.tolist() == [0, 1, 0, 2]
    assert np.allclose(found.mean, whole[[0, 1, 3]], atol=1e-6)
    kept = [0, 1, 2, 3, 6, 7]
    assert np.allclose(found.cov, (cov - gain @ h @ cov)[np.ix_(kept, kept)], atol=1e-5)


def test_a_wrong_association_is_taken_back_over_the_whole_log() -> None:
    """A robot drives a loop three times among twelve landmarks and turns 5 % too far; the filter's association is none at all."""
    rng = np.random.default_rng(1)
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    marks = np.column_stack([6 * np.cos(angle), 6 * np.sin(angle)]) + rng.normal(0, 0.5, (12, 2))
    track = [np.array([4.0, 0.0, np.pi / 2])]
    for _ in range(360):
        track.append(compose(track[-1][None], np.array([[4 * 2 * np.pi / 120, 0.0, 2 * np.pi / 120]]))[0])
    true = np.array(track)
    sd = np.array([0.02, 0.02, 0.01, 0.0])
    step = between(true[:-1], true[1:]) + rng.normal(0, sd[:3], (360, 3))
    step[:, 2] *= 1.05
    d = marks[None] - true[:, None, :2]
    bearing = np.arctan2(d[..., 1], d[..., 0]) - true[:, None, 2]
    bearing = np.arctan2(np.sin(bearing), np.cos(bearing))
    at, of = np.nonzero((np.hypot(*d.transpose(2, 0, 1)) < 4.5) & (np.abs(bearing) < 1.0))
    z = np.column_stack([np.hypot(*d[at, of].T), bearing[at, of]]) + rng.normal(0, (0.05, 0.01), (at.size, 2))
    log = Log(
        step=step,
        step_sd=np.tile(sd, (360, 1)),
        at=at,
        of=np.zeros_like(of),
        z=z,
        sd=np.tile([0.05, 0.01], (at.size, 1)),
    )
    best = whole_log_association.hypotheses(log, true[:1].repeat(361, axis=0))[0]
    assert best.marks.shape[0] == np.unique(of).size
    pairs = np.unique(np.column_stack([of, best.of])[best.of >= 0], axis=0)
    assert pairs.shape[0] == best.marks.shape[0]  # each landmark is one
    # a heading error of 0.01 rad a step, averaged over the 360 / 12 sightings of a lap
    assert np.sqrt(np.square(best.track[:, :2] - true[:, :2]).sum(axis=1).mean()) < 0.25
