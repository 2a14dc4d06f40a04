"""The track of a localiser: an estimate per update, odometry in between."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, compose
from pfcli.events import Sighting, Sounding, Sweep
from pfcli.systems.result import Track


class TrackKeeper:
    """Collects the scans and the estimates; every scan gets a pose, those between two updates by odometry."""

    def __init__(self) -> None:
        self._stamps_ns: list[int] = []
        self._odometry: list[tuple[float, float, float]] = []
        self._sources: list[str] = []
        self._update: list[int] = []
        self._poses: list[NDArray[np.float64]] = []
        self._covs: list[NDArray[np.float64]] = []

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
        self._update[-1] = len(self._poses)
        self._poses.append(pose)
        self._covs.append(cov)

    def replace(self, poses: NDArray[np.float64], covs: NDArray[np.float64]) -> None:
        """Other estimates (n, 3) and covariances (n, 3, 3) than those at the time: what is known afterwards."""
        self._poses, self._covs = list(poses), list(covs)

    def track(self, columns: dict[str, NDArray[Any]]) -> Track:
        """Poses of all scans since the first update; columns: values per update, repeated for the scans after it."""
        of = np.array(self._update, np.int64)
        first = int(np.argmax(of >= 0))
        of = of[first:]
        odometry = np.array(self._odometry[first:])
        fresh = np.r_[True, of[1:] != of[:-1]]
        start = np.flatnonzero(fresh)[np.cumsum(fresh) - 1]
        moved = between(odometry[start], odometry)
        estimates, covs = np.array(self._poses), np.array(self._covs)
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
        return Track(np.array(self._stamps_ns[first:], np.int64), poses, named)
