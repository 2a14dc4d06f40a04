"""A plain Monte Carlo localisation made of `core` parts, and an augmented one as AMCL has it: the baselines of the tables.

python benchmarks/plain_mcl.py MAP.yaml LOG.mcap [particles] [seed]
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pfcli.core.geometry import between, compose
from pfcli.core.grid.grid_map import GridMap
from pfcli.core.grid.scan_points import points_of
from pfcli.core.resample import systematic
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.dropped import Dropped
from pfcli.events import Sweep
from pfcli.formats import map_yaml
from pfcli.replay import align
from pfcli.replay.log import Log
from pfcli.replay.settings import Drive

SIGMA_M, Z_RAND, BEAMS = 0.1, 0.05, 60


class PlainMcl:
    """Odometry motion, likelihood field, systematic resampling; no recovery, no idea of an outside."""

    def __init__(self, grid: GridMap, poses: NDArray[np.float64], seed: int) -> None:
        self.grid = grid
        self.poses = poses
        self.log_w = np.zeros(len(poses))
        self._rng = np.random.default_rng(seed)
        distance = ndimage.distance_transform_edt(grid.cells != 1) * grid.resolution_m
        self._field = np.log((1 - Z_RAND) * np.exp(-0.5 * (distance / SIGMA_M) ** 2) + Z_RAND)

    def update(self, moved: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Predict, weigh, estimate, resample. Returns the mean pose."""
        n = len(self.poses)
        d, a = np.hypot(*moved[:2]), abs(moved[2])
        sd = np.array([0.1 * d + 0.01, 0.1 * d + 0.01, 0.1 * a + 0.05 * d + 0.005])
        self.poses = compose(self.poses, moved + sd * self._rng.standard_normal((n, 3)))
        c, s = np.cos(self.poses[:, 2, None]), np.sin(self.poses[:, 2, None])
        x = self.poses[:, 0, None] + c * points[:, 0] - s * points[:, 1]
        y = self.poses[:, 1, None] + s * points[:, 0] + c * points[:, 1]
        gx = np.floor((x - self.grid.origin.x_m) / self.grid.resolution_m).astype(int)
        gy = np.floor((y - self.grid.origin.y_m) / self.grid.resolution_m).astype(int)
        rows, cols = self._field.shape
        inside = (gx >= 0) & (gy >= 0) & (gx < cols) & (gy < rows)
        beams = np.where(inside, self._field[np.clip(gy, 0, rows - 1), np.clip(gx, 0, cols - 1)], np.log(Z_RAND))
        self.log_w = self.log_w + 0.3 * beams.sum(axis=1)
        self._seen(float(np.exp(0.3 * beams.sum(axis=1)).mean()))
        weights, _ = normalize(self.log_w)
        mean = weights @ self.poses
        mean[2] = np.arctan2(weights @ np.sin(self.poses[:, 2]), weights @ np.cos(self.poses[:, 2]))
        if effective_sample_size(weights) < 0.5 * n:
            self.poses = self.poses[systematic.ancestors(weights, self._rng.random(1))]
            self.log_w = np.zeros(n)
            self._inject()
        return mean

    def _seen(self, likelihood: float) -> None:
        """What is made of the mean likelihood of a scan: nothing."""

    def _inject(self) -> None:
        """Particles from elsewhere, after resampling: none."""


class AugmentedMcl(PlainMcl):
    """Random particles when the likelihood falls (Thrun 2005, table 8.3), with the decays that AMCL's documentation proposes."""

    slow, fast = 0.001, 0.1
    _w_slow, _w_fast = 0.0, 0.0

    def _seen(self, likelihood: float) -> None:
        self._w_slow += self.slow * (likelihood - self._w_slow) if self._w_slow else likelihood
        self._w_fast += self.fast * (likelihood - self._w_fast) if self._w_fast else likelihood

    @property
    def surprise(self) -> float:
        """Share of the particles that are drawn anywhere."""
        return max(0.0, 1.0 - self._w_fast / self._w_slow) if self._w_slow else 0.0

    def _inject(self) -> None:
        anew = self._rng.random(len(self.poses)) < self.surprise
        self.poses[anew] = anywhere(self.grid, int(anew.sum()), self._rng)


def anywhere(grid: GridMap, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Poses (n, 3) on free cells."""
    rows, cols = np.nonzero(grid.cells == 0)
    k = rng.integers(rows.size, size=n)
    x = grid.origin.x_m + (cols[k] + rng.random(n)) * grid.resolution_m
    y = grid.origin.y_m + (rows[k] + rng.random(n)) * grid.resolution_m
    return np.column_stack([x, y, rng.uniform(-np.pi, np.pi, n)])


def drive(mcl: PlainMcl, log_file: Path) -> Iterator[tuple[int, float, NDArray[np.float64]]]:
    """Stamp, way (m) and mean pose of each update on a log."""
    last, way = None, 0.0
    for sweep in align.sweeps(Log(log_file).events(["odometry", "scan"]), "odometry", Drive(), Dropped()):
        assert isinstance(sweep, Sweep)
        now = np.array([sweep.odometry])
        moved = between(now if last is None else last, now)[0]
        if last is not None and np.hypot(*moved[:2]) < 0.1 and abs(moved[2]) < 0.1:
            continue
        way += float(np.hypot(*moved[:2]))
        scan, last = sweep.scan, now
        angles = (scan.angle_min_rad, scan.angle_increment_rad)
        limits = (scan.range_min_m, scan.range_max_m)
        stride = max(1, scan.ranges_m.size // BEAMS)
        points = points_of(scan.ranges_m, angles, limits, scan.mount, stride, 0.0, 0.05).ends
        yield sweep.stamp_ns, way, mcl.update(moved, points)


def main(map_file: str, log_file: str, particles: str = "2000", seed: str = "0") -> None:
    """Track from the first true pose; print the RMSE against truth."""
    truth = {e.stamp_ns: np.array(e[1:4]) for e in Log(Path(log_file)).events(["truth"])}
    start, rng = next(iter(truth.values())), np.random.default_rng(int(seed))
    poses = start + rng.normal(0, [0.1, 0.1, 0.05], (int(particles), 3))
    mcl = PlainMcl(map_yaml.read(Path(map_file)), poses, int(seed))
    found = [(pose, truth[t]) for t, _, pose in drive(mcl, Path(log_file)) if t in truth]
    errors = [np.hypot(*(pose - true)[:2]) for pose, true in found]
    print(
        f"plain MCL, {particles} particles: RMSE {np.sqrt(np.mean(np.square(errors))):.4f} m over {len(errors)} updates"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
