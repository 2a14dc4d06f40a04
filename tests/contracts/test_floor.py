"""The numerical floor: every system at the edges of what can be asked of it is right, or says why it refuses."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfcli import registry
from pfcli.core.grid.grid_map import GridMap
from pfcli.errors import LogError
from pfcli.events import Event, Landmarks, LinePoints, Odometry, Pose2, Scan, Truth
from pfcli.formats import map_yaml
from pfcli.formats.log_writer import LogWriter
from pfcli.params import build
from pfcli.replay.dead_reckoning import Drive
from pfcli.replay.log import Log, Settings
from pfcli.runs import loop
from tests.contracts.test_systems import DRIVES, MAPS, RUNS, SAMPLES

SECONDS = {"slam-gdr-landmarks": 10, "fuse-soccer": 4, "slam-gdr": 15, "localize-lookup": 15, "localize-reliable": 15}
LASER = [name for name in registry.SYSTEMS if name not in ("slam-gdr-landmarks", "fuse-soccer")]
FAR_M = (5e5, 1e7)
"""As of a map projection (UTM)."""
ROLES = ("odometry", "encoders", "twist", "scan", "lines", "landmarks", "compass", "truth")


@cache
def _events(name: str) -> tuple[Any, ...]:
    log = Log(SAMPLES / f"{RUNS[name][0]}.mcap", Settings(end_s=SECONDS.get(name, 20)))
    return tuple(log.events([role for role in ROLES if role in log.roles()]))


def _log(name: str, path: Path, change: Callable[[Any], Any] = lambda event: event) -> Path:
    with LogWriter(path, "none") as out:
        for event in map(change, _events(name)):
            if isinstance(event, Scan):
                out.scan(event, frame="base_link")
            else:
                out.event(event)
    return path


def _run(
    name: str, log: Path, params: dict[str, Any], grid: Path | None = None, end_s: float | None = None
) -> loop.Run:
    system = registry.system(name)
    drive = DRIVES.get(name, Drive(radius_m=(0.1,), track_m=0.33))
    reading = Settings(end_s=end_s)
    built = build(system.params, params, "test")
    return loop.execute(loop.Job(system, built, [log], settings=reading, map=grid or MAPS.get(name), drive=drive))


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


@pytest.mark.parametrize("name", list(registry.SYSTEMS))
def test_one_particle(name: str, tmp_path: Path) -> None:
    _sound(_run(name, _log(name, tmp_path / "x.mcap"), {"particles": 1}))


@pytest.mark.parametrize("name", [n for n in registry.SYSTEMS if n != "slam-gdr"])
def test_a_hundred_thousand_particles(name: str, tmp_path: Path) -> None:
    _sound(_run(name, _log(name, tmp_path / "x.mcap"), {"particles": 100_000}, end_s=1.0))


@pytest.mark.parametrize("name", list(registry.SYSTEMS))
def test_one_beam(name: str, tmp_path: Path) -> None:
    log = _log(name, tmp_path / "x.mcap", _one)
    if name == "localize-partial":  # needs a scan to be worth something
        with pytest.raises(LogError, match="usable beam"):
            _run(name, log, {})
    else:
        _sound(_run(name, log, {}))


@pytest.mark.parametrize("name", LASER)
def test_scans_that_contradict_everything(name: str, tmp_path: Path) -> None:
    """A wall at 0.3 m all around, wherever the robot drives: every weight of every particle is as bad as can be."""

    def contradict(event: Event) -> Event:
        return event._replace(ranges_m=np.full_like(event.ranges_m, 0.3)) if isinstance(event, Scan) else event

    _sound(_run(name, _log(name, tmp_path / "x.mcap", contradict), {}))


@pytest.mark.parametrize("name", [n for n in registry.SYSTEMS if n != "fuse-soccer"])
def test_coordinates_of_a_map_projection_change_no_more_than_the_last_digits(name: str, tmp_path: Path) -> None:
    """Odometry (and the map of a localiser) ten thousand kilometres away: a double still holds a nanometre of that."""

    def away(event: Event) -> Event:
        if isinstance(event, Odometry | Truth):
            return event._replace(x_m=event.x_m + FAR_M[0], y_m=event.y_m + FAR_M[1])
        return event

    grid = None
    if name in MAPS:
        here = map_yaml.read(MAPS[name])
        there = Pose2(here.origin.x_m + FAR_M[0], here.origin.y_m + FAR_M[1], here.origin.yaw_rad)
        map_yaml.write(tmp_path, here._replace(origin=there), "far")
        grid = tmp_path / "far.yaml"
    near = _run(name, _log(name, tmp_path / "x.mcap"), {})
    far = _run(name, _log(name, tmp_path / "y.mcap", away), {}, grid)
    _sound(far)
    if name != "localize-partial":  # its draws of a start go by cells, whose borders a nanometre can move
        a, b = (done.result.track.poses[:, :2] for done in (near, far))
        # a Metropolis decision can flip by a nanometre as well: other draws of the same posterior
        within = 0.05 if name == "localize-lookup" else 1e-3
        assert np.allclose(b - b[0], a - a[0], atol=within, equal_nan=True)
        assert name not in MAPS or np.allclose(b[0] - a[0], FAR_M, atol=within)


@pytest.mark.parametrize("name", list(registry.SYSTEMS))
def test_stamps_that_begin_at_nought(name: str, tmp_path: Path) -> None:
    first = min(event.stamp_ns for event in _events(name))
    log = _log(name, tmp_path / "x.mcap", lambda event: event._replace(stamp_ns=event.stamp_ns - first))
    done = _run(name, log, {})
    _sound(done)
    assert not done.loss


@pytest.mark.parametrize("resolution_m", [0.005, 1.0])
def test_slam_in_fine_and_coarse_cells(resolution_m: float, tmp_path: Path) -> None:
    log = _log("slam-gdr", tmp_path / "x.mcap")
    done = _run("slam-gdr", log, {"resolution_m": resolution_m}, end_s=3.0 if resolution_m < 0.01 else None)
    _sound(done)
    assert done.result.grid is not None
    assert done.result.grid.resolution_m == resolution_m


@pytest.mark.parametrize("resolution_m", [pytest.param(0.005, marks=pytest.mark.slow), 1.0])
@pytest.mark.parametrize("name", list(MAPS))
def test_localisers_in_fine_and_coarse_maps(name: str, resolution_m: float, tmp_path: Path) -> None:
    grid = map_yaml.read(MAPS[name])
    if resolution_m < grid.resolution_m:
        k = round(grid.resolution_m / resolution_m)
        cells = np.kron(grid.cells, np.ones((k, k), np.int8))
    else:
        k = round(resolution_m / grid.resolution_m)
        rows, cols = (n // k for n in grid.cells.shape)
        blocks = grid.cells[: rows * k, : cols * k].reshape(rows, k, cols, k)
        cells = np.where((blocks == 1).any((1, 3)), 1, np.where((blocks == 0).any((1, 3)), 0, -1)).astype(np.int8)
    map_yaml.write(tmp_path, GridMap(cells, resolution_m, grid.origin), "other")
    _sound(_run(name, _log(name, tmp_path / "x.mcap"), {}, tmp_path / "other.yaml", end_s=4.0))
