"""A bounded, evenly spaced choice of updates to draw."""

import numpy as np
from numpy.typing import NDArray

from pfcli.systems.shared.contract import Frame

MOST = 500
PARTICLES = 200


class FrameKeeper:
    """Keeps every k-th update; k doubles when twice as many as MOST are held, so memory does not grow with the log."""

    def __init__(self) -> None:
        self._every = 1
        self._seen = 0
        self._kept: list[Frame] = []

    def offer(
        self,
        stamp_ns: int,
        pose: NDArray[np.float64],
        particles: NDArray[np.float64],
        scan_m: NDArray[np.float32] | NDArray[np.float64],
        labels: NDArray[np.uint8] | None = None,
    ) -> None:
        """Keep this update if its turn has come."""
        if self._seen % self._every == 0:
            stride = -(-particles.shape[0] // PARTICLES) or 1
            drawn = particles[::stride].copy()
            classes = np.zeros(drawn.shape[0], np.uint8) if labels is None else labels[::stride].copy()
            self._kept.append(Frame(stamp_ns, pose.copy(), drawn, classes, scan_m.astype(np.float32)))
            if len(self._kept) >= 2 * MOST:
                self._kept = self._kept[::2]
                self._every *= 2
        self._seen += 1

    def frames(self) -> list[Frame]:
        """At most MOST frames, evenly spaced."""
        stride = -(-len(self._kept) // MOST) or 1
        return self._kept[::stride]
