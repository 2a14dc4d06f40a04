"""What a filter leaves of its run: a pose of every reading, an estimate per update, and a choice of updates to draw."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core.estimate import PoseEstimate
from pfcli.events import Sighting, Sounding, Sweep
from pfcli.systems.shared.contract import Frame, Track
from pfcli.systems.shared.frame_keeper import FrameKeeper
from pfcli.systems.shared.track_keeper import TrackKeeper


class RunRecord:
    """Collects the readings and the estimates."""

    def __init__(self) -> None:
        self.track = TrackKeeper()
        self._frames = FrameKeeper()
        self._stamp_ns = 0

    def see(self, reading: Sweep | Sounding | Sighting) -> None:
        """Record a reading, whether it updates the filter or not."""
        self._stamp_ns = reading.stamp_ns
        self.track.see(reading)

    @property
    def updates(self) -> int:
        """Estimates so far."""
        return self.track.updates

    def report(
        self,
        found: PoseEstimate,
        particles: NDArray[np.float64],
        scan_m: NDArray[np.float32] | NDArray[np.float64],
        labels: NDArray[np.uint8] | None = None,
    ) -> None:
        """The estimate at the reading that was seen last (NaN where there is none), and what to draw of this update.

        particles: (n, 3) m, m, rad, map frame; scan_m: (b, 2) end points in the base frame; labels: (n,) classes of the
        particles.
        """
        self.track.update(found.pose, found.cov)
        self._frames.offer(self._stamp_ns, found.pose, particles, scan_m, labels)

    def poses(self, columns: dict[str, NDArray[Any]] | None = None) -> Track:
        """Poses of all readings since the first update; columns: values per update, by name."""
        return self.track.track(columns or {})

    def frames(self) -> list[Frame]:
        """The updates to draw."""
        return self._frames.frames()
