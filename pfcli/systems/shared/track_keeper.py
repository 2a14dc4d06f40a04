"""The track of a localiser: an estimate per update, odometry in between."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.core.rows import Rows
from pfcli.events import Sighting, Sounding, Sweep
from pfcli.systems.shared.contract import Track


class TrackKeeper:
    """Collects the scans and the estimates; every scan gets a pose, those between two updates by odometry."""

    def __init__(self) -> None:
        self._stamps_ns = Rows((), np.int64)
        self._odometry = Rows((3,))
        self._sources: list[str] = []
        self._update = Rows((), np.int64)
        self._poses = Rows((3,))
        self._covs = Rows((3, 3))

    def see(self, sweep: Sweep | Sounding | Sighting) -> None:
        """Take note of a scan, a sounding or a sighting."""
        self._stamps_ns.append(sweep.stamp_ns)
        self._odometry.append(sweep.odometry)
        self._sources.append(sweep.source_stamp)
        self._update.append(len(self._poses) - 1)

    @property
    def updates(self) -> int:
        """Estimates so far."""
        return len(self._poses)

    def update(self, pose: NDArray[np.float64], cov: NDArray[np.float64]) -> None:
        """The estimate (3,), NaN where there is none, and its covariance (3, 3) at the scan that was seen last."""
        self._update.set_last(len(self._poses))
        self._poses.append(pose)
        self._covs.append(cov)

    def replace(self, poses: NDArray[np.float64], covs: NDArray[np.float64]) -> None:
        """Other estimates (n, 3) and covariances (n, 3, 3) than those at the time: what is known afterwards."""
        self._poses, self._covs = Rows((3,)), Rows((3, 3))
        self._poses.extend(poses)
        self._covs.extend(covs)

    def track(self, columns: dict[str, NDArray[Any]]) -> Track:
        """Poses of all scans since the first update; columns: values per update, repeated for the scans after it."""
        of = self._update.array()
        first = int(np.argmax(of >= 0))
        of = of[first:]
        odometry = self._odometry.array()[first:]
        fresh = np.r_[True, of[1:] != of[:-1]]
        start = np.flatnonzero(fresh)[np.cumsum(fresh) - 1]
        moved = between(odometry[start], odometry)
        estimates, covs = self._poses.array(), self._covs.array()
        poses = compose(estimates[of], moved)
        named = {
            "cov_xx_m2": covs[of, 0, 0],
            "cov_xy_m2": covs[of, 0, 1],
            "cov_yy_m2": covs[of, 1, 1],
            "cov_yawyaw_rad2": covs[of, 2, 2],
            "update": fresh,
            "source_stamp": self._sources[first:],
        }
        named |= {name: values[of] for name, values in columns.items()}
        return Track(self._stamps_ns.array()[first:], poses, named)
