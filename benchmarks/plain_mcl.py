"""A plain Monte Carlo localisation made of `core` parts: the baseline of later tables.

python benchmarks/plain_mcl.py MAP.yaml LOG.mcap [particles] [seed]
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pfcli import align
from pfcli.core.geometry import between, compose
from pfcli.core.grid.scan_points import points_of
from pfcli.core.resample import systematic
from pfcli.core.weights import effective_sample_size, normalize
from pfcli.dead_reckoning import Drive
from pfcli.formats import map_yaml
from pfcli.loss import Loss
from pfcli.replay import Log

SIGMA_M, Z_RAND, BEAMS = 0.1, 0.05, 60


class PlainMcl:
    """Odometry motion, likelihood field, systematic resampling; no recovery, no idea of an outside."""

    def __init__(self, grid: map_yaml.GridMap, poses: NDArray[np.float64], seed: int) -> None:
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
        weights, _ = normalize(self.log_w)
        mean = weights @ self.poses
        mean[2] = np.arctan2(weights @ np.sin(self.poses[:, 2]), weights @ np.cos(self.poses[:, 2]))
        if effective_sample_size(weights) < 0.5 * n:
            self.poses = self.poses[systematic.ancestors(weights, self._rng.random(1))]
            self.log_w = np.zeros(n)
        return mean


def main(map_file: str, log_file: str, particles: str = "2000", seed: str = "0") -> None:
    """Track from the first true pose; print the RMSE against truth."""
    log = Log(Path(log_file))
    truth = {e.stamp_ns: np.array(e[1:4]) for e in Log(Path(log_file)).events(["truth"])}
    mcl, last, errors = None, None, []
    for sweep in align.sweeps(log.events(["odometry", "scan"]), "odometry", Drive(), Loss()):
        if sweep.stamp_ns not in truth:
            continue
        now = np.array([sweep.odometry])
        if mcl is None or last is None:
            poses = truth[sweep.stamp_ns] + np.random.default_rng(int(seed)).normal(
                0, [0.1, 0.1, 0.05], (int(particles), 3)
            )
            mcl, last = PlainMcl(map_yaml.read(Path(map_file)), poses, int(seed)), now
            continue
        moved = between(last, now)[0]
        if np.hypot(*moved[:2]) < 0.1 and abs(moved[2]) < 0.1:
            continue
        scan, last = sweep.scan, now
        angles = (scan.angle_min_rad, scan.angle_increment_rad)
        limits = (scan.range_min_m, scan.range_max_m)
        stride = max(1, scan.ranges_m.size // BEAMS)
        points = points_of(scan.ranges_m, angles, limits, scan.mount, stride, 0.0, 0.05).ends
        errors.append(np.hypot(*(mcl.update(moved, points) - truth[sweep.stamp_ns])[:2]))
    print(
        f"plain MCL, {particles} particles: RMSE {np.sqrt(np.mean(np.square(errors))):.4f} m over {len(errors)} updates"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
