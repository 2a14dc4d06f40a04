"""Logs of one drive whose frames are told in many ways: the same readings in the base frame, or a refusal that says why."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.core import rigid
from pfcli.errors import LogError, UsageError
from pfcli.events import Odometry, Scan
from pfcli.formats.log_writer import LogWriter
from pfcli.formats.message_writer import header
from pfcli.replay.log import Log
from pfcli.replay.settings import Band, Settings
from tests.replay.frames import robot_log as r
from tests.replay.frames.robot_log import LASER, motion_at, pose_at, simple, walls_off

UP = rigid.from_euler((0.0, 0.0, 0.1), 0.0, 0.0, 0.0)
NEAR_M = 1e-4


def read(path: Path, *roles: str, **settings: Any) -> list[Any]:
    return list(Log(path, Settings(**settings)).events(roles or ("odometry", "scan")))


def as_the_plain_one(path: Path, **settings: Any) -> None:
    """Every scan lies on the walls seen from the true poses, and the odometry is that of the base."""
    events = read(path, **settings)
    scans, odometry = ([e for e in events if isinstance(e, t)] for t in (Scan, Odometry))
    assert len(scans) == len(odometry) == 3
    first = motion_at(0)
    for k in range(3):
        assert walls_off(scans[k], k) < NEAR_M
        moved = rigid.inverse(first) @ motion_at(k)
        base = rigid.from_euler((odometry[0].x_m, odometry[0].y_m, 0), 0, 0, odometry[0].yaw_rad)
        got = rigid.inverse(base) @ rigid.from_euler((odometry[k].x_m, odometry[k].y_m, 0), 0, 0, odometry[k].yaw_rad)
        assert np.allclose(moved, got, atol=1e-6)


@pytest.mark.parametrize(
    ("rows", "frame", "child"),
    [
        ([("base_link", "laser", LASER)], "laser", "base_link"),
        ([("base_link", "laser", LASER)], "/laser", "/base_link"),
        ([("laser", "base_link", rigid.inverse(LASER))], "laser", "base_link"),
        ([("odom", "base_link", UP), ("base_link", "laser", LASER)], "laser", "base_link"),
        ([("base_footprint", "base_link", UP), ("base_link", "laser", LASER)], "laser", "base_footprint"),
        (
            [("camera", "base_link", UP), ("base_link", "deck", UP), ("deck", "laser", rigid.inverse(UP) @ LASER)],
            "laser",
            "",
        ),
        ([("r1/base_link", "r1/laser", LASER)], "r1/laser", "r1/base_link"),
        ([("chassis", "laser", LASER)], "laser", "chassis"),
    ],
)
def test_the_tree_may_hang_anyhow(rows: Any, frame: str, child: str, tmp_path: Path) -> None:
    as_the_plain_one(simple(tmp_path / "x.mcap", rows, frame, child))


def test_two_robots_keep_their_own_transforms(tmp_path: Path) -> None:
    path, other = tmp_path / "x.mcap", rigid.from_euler((-0.5, 0.3, 0.2), 0.0, 0.0, math.pi)
    with LogWriter(path) as log:
        for name, laser in (("r1", LASER), ("r2", other)):
            r.tf(log, f"/{name}/tf_static", 0, [("base_link", "laser", laser)])
            for k in range(3):
                r.odometry(log, k, motion_at(k), topic=f"/{name}/odom")
                r.scan(log, k, laser, topic=f"/{name}/front/scan")
    for name in ("r1", "r2"):
        as_the_plain_one(path, topics={"odometry": f"/{name}/odom", "scan": f"/{name}/front/scan"})
        as_the_plain_one(path, robot=name)


def test_a_topic_without_a_namespace_beside_two_robots_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        r.tf(log, "/r1/tf_static", 0, [("base_link", "laser", LASER)])
        r.tf(log, "/r2/tf_static", 0, [("base_link", "laser", UP)])
        r.odometry(log, 0, motion_at(0))
        r.scan(log, 0)
    with pytest.raises(LogError, match=r"'r1' and 'r2' both have laser on base_link.*--robot"):
        read(path)
    assert len(read(path, robot="r1")) == 2


def test_one_topic_that_gives_two_values_is_refused_with_both(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        r.tf(log, "/tf_static", 0, [("base_link", "laser", LASER), ("base_link", "unused", UP)])
        r.tf(log, "/tf_static", 1, [("base_link", "laser", UP)])
        r.odometry(log, 0, motion_at(0))
        r.scan(log, 0)
    with pytest.raises(LogError, match=r"gives base_link -> laser twice.*0\.200, 0\.100.*0\.000, 0\.000, 0\.100"):
        read(path)
    assert len(read(path, extrinsics=("base_link:laser=0.2,0.1,0.3",))) == 2


def test_a_missing_frame_prints_the_trees(tmp_path: Path) -> None:
    path = simple(tmp_path / "x.mcap", [("base_link", "deck", UP), ("world", "other", UP)])
    with pytest.raises(LogError, match=r"base_link > deck; world > other.*--extrinsic base_link:laser="):
        read(path)


def test_mounts_that_only_tf_knows(tmp_path: Path) -> None:
    """ROS 1: static transforms are repeated on /tf; odometry moves there too, and nothing else has it."""
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        for k in range(4):
            rows = [
                ("odom", "base_footprint", motion_at(k)),
                ("base_footprint", "base_link", UP),
                ("base_link", "laser", LASER),
            ]
            r.tf(log, "/tf", k, rows)
            if k < 3:
                r.scan(log, k)
    log = Log(path)
    assert log.take_transforms()
    assert log.settings.topics["odometry"] == "/tf:odom.base_footprint"
    scans = [e for e in log.events(["odometry", "scan"]) if isinstance(e, Scan)]
    assert max(walls_off(s, k) for k, s in enumerate(scans)) < NEAR_M
    composed = read(path, "odometry", topics={"odometry": "/tf:odom.base_link"})
    assert [e[1:4] for e in composed] == [pytest.approx(pose_at(k)) for k in range(4)]


def test_a_pair_that_tf_never_has_names_what_moves(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        for k in range(3):
            r.tf(log, "/tf", k, [("odom", "base_footprint", motion_at(k))])
    with pytest.raises(UsageError, match=r"never has odom -> base_link; what moves is odom -> base_footprint"):
        read(path, "odometry", topics={"odometry": "/tf:odom.base_link"})


def test_truth_composed_over_a_chain_of_moving_transforms(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    drift = [rigid.from_euler((0.01 * k, 0.0, 0.0), 0.0, 0.0, 0.02 * k) for k in range(0, 12)]
    with LogWriter(path) as log:
        for k in range(11):
            r.tf(log, "/tf", k, [("odom", "base_link", motion_at(k))])
            if k % 5 == 0:
                r.tf(log, "/tf", k, [("map", "odom", drift[k])])
    events = read(path, "truth", topics={"truth": "/tf:map.base_link"})
    assert len(events) == 11
    for k, event in enumerate(events):
        true = drift[k] @ motion_at(k)
        assert event[1:4] == pytest.approx((true[0, 3], true[1, 3], rigid.yaw_of(true)), abs=1e-3)


def test_a_scanner_on_a_joint_that_turns(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        r.tf(log, "/tf_static", 0, [("pan", "laser", UP)])
        for k in range(4):
            head = rigid.from_euler((0.2, 0.0, 0.3), 0.0, 0.0, 0.2 * k)
            r.tf(log, "/tf", k, [("base_link", "pan", head)])
            r.odometry(log, k, motion_at(k))
            r.scan(log, k, head @ UP)
    scans = read(path, "scan")
    assert max(walls_off(s, k) for k, s in enumerate(scans)) < NEAR_M


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.4), (0.3, -0.2, 0.5), (-math.pi / 2, 0.0, -math.pi / 2)])
def test_odometry_of_a_camera_is_brought_to_the_base(turn: tuple[float, float, float], tmp_path: Path) -> None:
    """Whichever way the camera and its world lie."""
    camera = rigid.from_euler((0.4, -0.1, 0.5), *turn)
    world = rigid.from_euler((1.0, 2.0, 3.0), 0.3, -1.0, 2.0)
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        r.tf(log, "/tf_static", 0, [("base_link", "camera", camera), ("base_link", "laser", LASER)])
        for k in range(3):
            r.odometry(log, k, world @ motion_at(k) @ camera, "camera")
            r.scan(log, k)
    as_the_plain_one(path)


def test_the_twist_of_a_camera_is_the_bases(tmp_path: Path) -> None:
    """v + w x lever: a camera 0.4 m ahead of a robot that turns on the spot moves sideways."""
    camera = rigid.from_euler((0.4, 0.0, 0.5), 0.0, 0.0, math.pi / 2)
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        r.tf(log, "/tf_static", 0, [("base_link", "camera", camera)])
        r.odometry(log, 0, camera, "camera", linear=(0.4 * 1.5, 0.0, 0.0), angular=(0.0, 0.0, 1.5))
    (event,) = read(path, "odometry")
    assert event[4:] == pytest.approx((0.0, 0.0, 1.5), abs=1e-9)


def test_a_camera_that_nothing_places_is_refused(tmp_path: Path) -> None:
    path = simple(tmp_path / "x.mcap", [("base_link", "laser", LASER)], child="camera_pose")
    with pytest.raises(
        LogError, match=r"of 'camera_pose'.*--extrinsic base_link:camera_pose=.*--base-frame camera_pose"
    ):
        read(path)
    as_the_plain_one(path, extrinsics=("base_link:camera_pose=0,0,0",))


def test_quaternions_of_any_length(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        r.tf(log, "/tf_static", 0, [("base_link", "laser", LASER)], scale=1.7)
        for k in range(3):
            r.odometry(log, k, motion_at(k))
            r.scan(log, k)
    as_the_plain_one(path)


@pytest.mark.parametrize("roll", [0.0, math.pi])
@pytest.mark.parametrize(("pitch", "lean"), [(0.3, 0.0), (-0.35, 0.1), (0.0, 0.5)])
def test_a_scanner_that_leans_sees_the_same_walls(pitch: float, lean: float, roll: float, tmp_path: Path) -> None:
    laser = rigid.from_euler((0.2, 0.1, 1.0), roll + lean, pitch, 0.3)
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        r.tf(log, "/tf_static", 0, [("base_link", "laser", laser)])
        for k in range(3):
            r.odometry(log, k, motion_at(k))
            r.scan(log, k, laser)
    as_the_plain_one(path, band=Band(-9.0, 9.0))
    log_ = Log(path)
    seen = list(log_.events(["scan"]))
    assert walls_off(seen[0], 0) < NEAR_M
    off = log_.dropped.read["beams that met floor or ceiling"]
    gone = sum(int(np.isnan(s.ranges_m).sum()) for s in seen)  # type: ignore[union-attr]
    assert off == gone
    assert off > 0 or pitch < 0  # nothing says that what is high up is a ceiling


@pytest.mark.parametrize("turn", [(math.pi / 2, 0.0, 0.0), (0.0, math.pi / 2, 0.0), (0.0, 1.0, 0.0)])
def test_a_scanner_on_its_edge_is_refused_with_its_angle(turn: tuple[float, float, float], tmp_path: Path) -> None:
    path = simple(tmp_path / "x.mcap", [("base_link", "laser", rigid.from_euler((0, 0, 1), *turn))])
    with pytest.raises(LogError, match=r"leans by (90\.0|57\.3) deg"):
        read(path)


def imu(log: LogWriter, k: int, rates: Any, pulled: Any, frame: str = "imu", absent: bool = False) -> None:
    nine = np.zeros(9)
    marked = np.array([-1.0, *np.zeros(8)]) if absent else nine
    turn = r.kind("geometry_msgs/msg/Quaternion")(0.0, 0.0, 0.0, 1.0)
    made = r.kind("sensor_msgs/msg/Imu")(
        header(r.T0 + k, frame), turn, nine, r.vector(rates), marked, r.vector(pulled), nine
    )
    log.message("/imu", "sensor_msgs/msg/Imu", r.T0 + k, made)


@given(st.tuples(*[st.floats(-3.1, 3.1)] * 3), st.floats(-2, 2))
def test_turn_rates_are_about_the_bases_vertical(turn: tuple[float, float, float], rate: float) -> None:
    """However the IMU is mounted: by its transform, and by gravity where it has none."""
    import tempfile

    mount = rigid.from_euler((0.1, 0.0, 0.2), *turn)
    rates = mount[:3, :3].T @ np.array([0.0, 0.0, rate])
    pulled = mount[:3, :3].T @ np.array([0.0, 0.0, 9.81])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.mcap"
        with LogWriter(path) as log:
            r.tf(log, "/tf_static", 0, [("base_link", "imu", mount)])
            imu(log, 0, rates, (0.0, 0.0, 0.0))
        (event,) = read(path, "imu")
        assert event.yaw_rate_radps == pytest.approx(rate, abs=1e-6)
        with LogWriter(path) as log:
            imu(log, 0, rates, pulled)
        (event,) = read(path, "imu")
        assert event.yaw_rate_radps == pytest.approx(rate, abs=1e-6)


def test_an_imu_without_a_gyroscope_is_no_motion(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        r.tf(log, "/tf_static", 0, [("base_link", "imu", UP)])
        imu(log, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 9.81), absent=True)
    opened = Log(path)
    assert list(opened.events(["imu"])) == []
    assert "no gyroscope" in opened.dropped.notes[0]


def test_a_twist_that_is_marked_absent_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with LogWriter(path) as log:
        r.odometry(log, 0, motion_at(0), linear=(1.0, 0.0, 0.0), covariance=-1.0)
    (event,) = read(path, "odometry")
    assert math.isnan(event.vx_mps)


SPIN = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
PLACE = st.tuples(*[st.floats(-2.0, 2.0)] * 3)
NAMES = ("base_link", "laser", "deck", "camera", "roof")


@st.composite
def retold(draw: Any) -> tuple[list[tuple[str, str, Any]], str, str]:
    """A random tree of five frames on the robot, with a random prefix and slash, rooted anywhere."""
    poses = {"base_link": np.eye(4), "laser": LASER}
    for name in NAMES[2:]:
        poses[name] = rigid.from_euler(draw(PLACE), *draw(SPIN))
    order = draw(st.permutations(NAMES))
    rows = []
    prefix = draw(st.sampled_from(["", "robot/", "a/b/"]))
    slash = draw(st.sampled_from(["", "/"]))
    for k, child in enumerate(order[1:], 1):
        parent = order[draw(st.integers(0, k - 1))]
        rows.append((slash + prefix + parent, prefix + child, rigid.inverse(poses[parent]) @ poses[child]))
    return draw(st.permutations(rows)), prefix, slash


@given(retold(), st.sampled_from(["base_link", "camera", "deck"]), st.sampled_from(["", "/r7"]), st.integers(-10, 10))
def test_a_log_in_other_frames_says_the_same(told: Any, body: str, space: str, shift: int) -> None:
    """Any tree, any body whose odometry it is, any namespace, any clock with its flag."""
    import tempfile

    rows, prefix, slash = told
    on = {"base_link": np.eye(4)}
    while body not in on:
        for parent, child, motion in rows:
            a, b = parent.rpartition("/")[2], child.rpartition("/")[2]
            if a in on:
                on[b] = on[a] @ motion
            elif b in on:
                on[a] = on[b] @ rigid.inverse(motion)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.mcap"
        with LogWriter(path) as log:
            r.tf(log, f"{space}/tf_static", 0, rows)
            for k in range(3):
                r.odometry(log, k, motion_at(k) @ on[body], prefix + body, topic=f"{space}/odom")
                r.scan(log, k + shift, frame=slash + prefix + "laser", topic=f"{space}/scan")
        # the scans of step k carry the stamp of step k + shift, but show the room from where the robot was then
        events = read(path, offsets_s={"scan": -shift / 10}, reorder_s=5.0)
    scans = [e for e in events if isinstance(e, Scan)]
    odometry = [e for e in events if isinstance(e, Odometry)]
    assert [s.stamp_ns for s in scans] == [o.stamp_ns for o in odometry]
    for k in range(3):
        assert walls_off(scans[k], k + shift) < 1e-3
        moved = rigid.inverse(motion_at(0)) @ motion_at(k)
        first = rigid.from_euler((odometry[0].x_m, odometry[0].y_m, 0), 0, 0, odometry[0].yaw_rad)
        got = rigid.inverse(first) @ rigid.from_euler((odometry[k].x_m, odometry[k].y_m, 0), 0, 0, odometry[k].yaw_rad)
        assert np.allclose(moved, got, atol=1e-6)
