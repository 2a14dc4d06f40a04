"""What a run of grid SLAM keeps of its past: of all particles only as far back as they differ."""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose, spread_residual
from pfcli.core.rows import Rows
from pfcli.events import Sweep
from pfcli.systems.shared.contract import Track
from pfcli.systems.slam_gdr.proposal_kernels import coalesced, trace

_SETTLE = 64
"""After so many updates, or twice as many as still differ, it is asked since when all particles have one past."""


class History:
    """Per scan its stamp, odometry pose and text; per update its scan, covariance, and the poses and parents of the particles.

    Where all particles that live have the same ancestor, its line is all that is kept of the time before.
    """

    def __init__(self) -> None:
        self._stamps_ns = Rows((), np.int64)
        self._odometry = Rows((3,))
        self._sources: list[str] = []
        self._scan_of_update = Rows((), np.int64)
        self._covariance = Rows((3, 3))
        self._settled = Rows((3,))
        self._poses: list[NDArray[np.float64]] = []
        self._parents: list[NDArray[np.int64]] = []
        self._next, self._alone = _SETTLE, False

    @property
    def updates(self) -> int:
        """Updates so far."""
        return len(self._scan_of_update)

    def see(self, sweep: Sweep) -> None:
        """Take note of a scan."""
        self._stamps_ns.append(sweep.stamp_ns)
        self._odometry.append(sweep.odometry)
        self._sources.append(sweep.source_stamp)

    def update(self, pose: NDArray[np.float64], parents: NDArray[np.int64], cov: NDArray[np.float64]) -> None:
        """Particles (n, 3) after the scan that was seen last, the one before it that each comes from (n,), covariance (3, 3)."""
        self._scan_of_update.append(len(self._stamps_ns) - 1)
        self._covariance.append(cov)
        self._alone = len(pose) == 1
        self._poses.append(pose)
        self._parents.append(parents)
        if len(self._poses) >= self._next:
            self._settle()
            self._next = max(_SETTLE, 2 * len(self._poses))  # so that asking stays cheap where they never agree

    def _settle(self) -> None:
        parents = np.array(self._parents)
        shared = int(coalesced(parents)) if parents.shape[1] > 1 else len(parents)
        if shared:
            ancestor = trace(parents, 0)[shared - 1]
            self._settled.extend(self._line(parents[:shared], ancestor))
            del self._poses[:shared], self._parents[:shared]

    def _line(self, parents: NDArray[np.int64], particle: int) -> NDArray[np.float64]:
        """Poses (m, 3) of a particle's ancestors at the first m of the updates that are kept whole."""
        line = trace(parents, particle)
        return np.array([poses[k] for poses, k in zip(self._poses, line, strict=False)]).reshape(-1, 3)

    def shared(self) -> int:
        """How many updates all particles of the end have in common."""
        if self._alone:
            return 0  # of one particle nobody else has a past
        return len(self._settled) + (int(coalesced(np.array(self._parents))) if self._parents else 0)

    def path(self, best: int) -> NDArray[np.float64]:
        """Poses (m, 3) of all updates, as the particle `best` of the end remembers them."""
        recent = self._line(np.array(self._parents), best) if self._parents else np.empty((0, 3))
        return np.concatenate([self._settled.array(), recent])

    def covariance(self) -> NDArray[np.float64]:
        """Covariances (m, 3, 3) of the particles at all updates."""
        return self._covariance.array()

    def update_stamps(self) -> NDArray[np.int64]:
        """Stamps (m,) of all updates, ns."""
        return np.asarray(self._stamps_ns.array()[self._scan_of_update.array()])

    def steps_at(self, offset_s: float) -> NDArray[np.float64]:
        """Odometry's steps (m - 1, 3) between the updates, with the odometry of `offset_s` after each scan."""
        stamps, odometry = self._stamps_ns.array(), self._odometry.array().copy()
        if offset_s == 0.0:
            poses = odometry[self._scan_of_update.array()]
        else:
            odometry[:, 2] = np.unwrap(odometry[:, 2])
            seconds = (stamps - stamps[0]) * 1e-9
            at = seconds[self._scan_of_update.array()] + offset_s
            poses = np.stack([np.interp(at, seconds, column) for column in odometry.T], axis=1)
        return np.asarray(between(poses[:-1], poses[1:]))

    def track(self, chosen: NDArray[np.float64], covariance: NDArray[np.float64]) -> Track:
        """Poses of all scans since the first update, given those of the updates (m, 3) and their covariances (m, 3, 3)."""
        updates, odometry = self._scan_of_update.array(), self._odometry.array()
        poses = np.empty((len(odometry), 3))
        spread = np.empty((len(odometry), 3, 3))
        for j, start in enumerate(updates):
            stop = updates[j + 1] if j + 1 < len(updates) else len(odometry)
            if j + 1 < len(updates):
                poses[start:stop] = spread_residual(chosen[j], chosen[j + 1], odometry[start:stop], odometry[stop])
            else:
                poses[start:] = compose(chosen[j : j + 1], between(odometry[start : start + 1], odometry[start:]))
            spread[start:stop] = covariance[j]
        keep = slice(updates[0], None)
        columns = {
            "cov_xx_m2": spread[keep, 0, 0],
            "cov_xy_m2": spread[keep, 0, 1],
            "cov_yy_m2": spread[keep, 1, 1],
            "cov_yawyaw_rad2": spread[keep, 2, 2],
            "update": np.isin(np.arange(len(odometry)), updates)[keep],
            "source_stamp": self._sources[keep],
        }
        return Track(self._stamps_ns.array()[keep], poses[keep], columns)
