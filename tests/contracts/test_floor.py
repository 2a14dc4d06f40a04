"""The numerical floor: every system at the edges of what can be asked of it is right, or says why it refuses."""

import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfcli.core.grid.grid_map import GridMap
from pfcli.errors import FilterDegenerate, LogError
from pfcli.events import Event, Landmarks, LinePoints, Odometry, Pose2, Scan, Truth
from pfcli.formats import map_yaml
from pfcli.formats.log_writer import LogWriter
from pfcli.params import fields
from pfcli.replay.log import Log
from pfcli.replay.settings import Settings
from pfcli.runs import loop
from pfcli.systems.shared.contract import System
from tests.contracts.examples import RECORDS, job_of, log_of, map_of

SECONDS = 10.0
LASER = {key: system for key, system in RECORDS.items() if any("scan" in need for need in system.needs)}
MAPPED = {key: system for key, system in RECORDS.items() if system.map}
MOVABLE = {key: system for key, system in RECORDS.items() if system.map or system.frame == "own"}
"""Systems whose frame can be moved: a field stands where it stands."""
SLAM = RECORDS["slam-gdr"]
FAR_M = (5e5, 1e7)
"""As of a map projection (UTM)."""
ROLES = ("odometry", "encoders", "twist", "scan", "lines", "landmarks", "compass", "truth")


@cache
def _events(path: Path) -> tuple[Any, ...]:
    log = Log(path, Settings(end_s=SECONDS))
    return tuple(log.events([role for role in ROLES if role in log.roles()]))


def _log(system: System, path: Path, change: Callable[[Any], Any] = lambda event: event) -> Path:
    with LogWriter(path, "none") as out:
        for event in map(change, _events(log_of(system))):
            if isinstance(event, Scan):
                out.scan(event, frame="base_link")
            else:
                out.event(event)
    return path


def _run(
    system: System, log: Path, params: dict[str, Any], grid: Path | None = None, end_s: float | None = None
) -> loop.Run:
    job = job_of(system, params, paths=[log], settings=Settings(end_s=end_s), map=grid or map_of(system))
    return loop.execute(job)


def _sound(done: loop.Run) -> None:
    """Poses are finite or not known at all (a robot that never was in the map), covariances have no negative variance."""
    track = done.result.track
    assert len(track.poses)
    assert (np.isfinite(track.poses).all(axis=1) | np.isnan(track.poses).all(axis=1)).all()
    for column in ("cov_xx_m2", "cov_yy_m2"):
        values = np.asarray(track.columns[column], float)
        assert (values[np.isfinite(values)] >= 0.0).all()


def _one(event: Event) -> Event:
    """The middle beam of a scan, one point, one landmark."""
    if isinstance(event, Scan):
        k = event.ranges_m.size // 2
        return event._replace(
            ranges_m=event.ranges_m[k : k + 1].copy(), angle_min_rad=event.angle_min_rad + k * event.angle_increment_rad
        )
    if isinstance(event, LinePoints):
        return event._replace(points_m=event.points_m[:1])
    if isinstance(event, Landmarks):
        columns: Sequence[Any] = [c[:1] for c in event[1:5]]
        return Landmarks(event.stamp_ns, *columns)
    return event


@pytest.mark.parametrize("system", RECORDS.values(), ids=RECORDS)
def test_one_particle(system: System, tmp_path: Path) -> None:
    _sound(_run(system, _log(system, tmp_path / "x.mcap"), {"particles": 1}))


@pytest.mark.parametrize("system", RECORDS.values(), ids=RECORDS)
def test_as_many_particles_as_may_be(system: System, tmp_path: Path) -> None:
    (field,) = (field for field in fields(system.params) if field.name == "particles")
    assert field.opt.le is not None
    count = min(100_000, int(field.opt.le))
    try:
        _sound(_run(system, _log(system, tmp_path / "x.mcap"), {"particles": count}, end_s=1.0))
    except FilterDegenerate as refused:  # maps of that many particles take more memory than is given to all maps
        assert "fewer --particles" in str(refused)  # noqa: PT017


@pytest.mark.parametrize("system", RECORDS.values(), ids=RECORDS)
def test_one_beam(system: System, tmp_path: Path) -> None:
    """It is enough, or the error says what would be."""
    log = _log(system, tmp_path / "x.mcap", _one)
    refused = pytest.RaisesExc(LogError, match=re.escape(system.unusable))
    try:
        _sound(_run(system, log, {}))
    except LogError as error:
        if not refused.matches(error):
            raise


@pytest.mark.parametrize("system", LASER.values(), ids=LASER)
def test_scans_that_contradict_everything(system: System, tmp_path: Path) -> None:
    """A wall at 0.3 m all around, wherever the robot drives: every weight of every particle is as bad as can be."""

    def contradict(event: Event) -> Event:
        return event._replace(ranges_m=np.full_like(event.ranges_m, 0.3)) if isinstance(event, Scan) else event

    _sound(_run(system, _log(system, tmp_path / "x.mcap", contradict), {}))


@pytest.mark.parametrize("system", MOVABLE.values(), ids=MOVABLE)
def test_coordinates_of_a_map_projection_change_no_more_than_the_last_digits(system: System, tmp_path: Path) -> None:
    """Odometry (and the map of a localiser) ten thousand kilometres away: a double still holds a nanometre of that."""

    def away(event: Event) -> Event:
        if isinstance(event, Odometry | Truth):
            return event._replace(x_m=event.x_m + FAR_M[0], y_m=event.y_m + FAR_M[1])
        return event

    grid = None
    if system.map:
        here = map_yaml.read(map_of(system))
        there = Pose2(here.origin.x_m + FAR_M[0], here.origin.y_m + FAR_M[1], here.origin.yaw_rad)
        map_yaml.write(tmp_path, here._replace(origin=there), "far")
        grid = tmp_path / "far.yaml"
    near = _run(system, _log(system, tmp_path / "x.mcap"), {})
    far = _run(system, _log(system, tmp_path / "y.mcap", away), {}, grid)
    _sound(far)
    a, b = (done.result.track.poses[:, :2] for done in (near, far))
    if system.map:
        # a draw among cells, or a Metropolis decision, can flip by a nanometre: other draws of the same posterior
        both = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
        if both.any():
            assert np.median(np.abs(b - a - FAR_M)[both]) < 0.05
    else:
        assert np.allclose(b - b[0], a - a[0], atol=1e-3, equal_nan=True)


@pytest.mark.parametrize("system", RECORDS.values(), ids=RECORDS)
def test_stamps_that_begin_at_nought(system: System, tmp_path: Path) -> None:
    first = min(event.stamp_ns for event in _events(log_of(system)))
    log = _log(system, tmp_path / "x.mcap", lambda event: event._replace(stamp_ns=event.stamp_ns - first))
    done = _run(system, log, {})
    _sound(done)
    assert not done.dropped


@pytest.mark.parametrize("resolution_m", [0.005, 1.0])
def test_slam_in_fine_and_coarse_cells(resolution_m: float, tmp_path: Path) -> None:
    log = _log(SLAM, tmp_path / "x.mcap")
    done = _run(SLAM, log, {"resolution_m": resolution_m}, end_s=3.0 if resolution_m < 0.01 else None)
    _sound(done)
    assert done.result.grid is not None
    assert done.result.grid.resolution_m == resolution_m


@pytest.mark.parametrize("resolution_m", [pytest.param(0.005, marks=pytest.mark.slow), 1.0])
@pytest.mark.parametrize("system", MAPPED.values(), ids=MAPPED)
def test_localisers_in_fine_and_coarse_maps(system: System, resolution_m: float, tmp_path: Path) -> None:
    grid = map_yaml.read(map_of(system))
    if resolution_m < grid.resolution_m:
        k = round(grid.resolution_m / resolution_m)
        cells = np.kron(grid.cells, np.ones((k, k), np.int8))
    else:
        k = round(resolution_m / grid.resolution_m)
        rows, cols = (n // k for n in grid.cells.shape)
        blocks = grid.cells[: rows * k, : cols * k].reshape(rows, k, cols, k)
        cells = np.where((blocks == 1).any((1, 3)), 1, np.where((blocks == 0).any((1, 3)), 0, -1)).astype(np.int8)
    map_yaml.write(tmp_path, GridMap(cells, resolution_m, grid.origin), "other")
    _sound(_run(system, _log(system, tmp_path / "x.mcap"), {}, tmp_path / "other.yaml", end_s=4.0))
