"""What a run says beside its poses: success, bounds, classes of beams, and obstacles that the map lacks."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import compose
from pfcli.core.grid.grid_map import GridMap
from pfcli.core.rows import Rows
from pfcli.systems.localize_reliable.particle_set import MODE_M
from pfcli.systems.localize_reliable.success_report import Judged

_TRUSTED, _SEEN_TWICE = 0.9, 2


class RunTables:
    """Collects per update; memory grows with the updates only, and with the beams where they are asked for."""

    def __init__(self, grid: GridMap, keep_beams: bool) -> None:
        self._grid = grid
        self._keep_beams = keep_beams
        self._counts = np.zeros(grid.cells.size, np.uint16)
        self._stamps_ns = Rows((), np.int64)
        self._protection = Rows()
        self._beams: list[NDArray[np.float32]] = []
        self._jumps_m = Rows()
        self._p_success = Rows()

    @property
    def count(self) -> int:
        """Number of updates."""
        return len(self._stamps_ns)

    def add(
        self,
        stamp_ns: int,
        pose: NDArray[np.float64],
        says: Judged,
        ends: NDArray[np.float32],
        predicted: NDArray[np.float64],
    ) -> None:
        """One update; ends: (2, b) end points of the beams (m, base frame); predicted: (3,) where odometry expected the pose."""
        self._jumps_m.append(float(np.hypot(*(pose - predicted)[:2])))
        self._stamps_ns.append(stamp_ns)
        self._p_success.append(says.p_success)
        self._protection.append(says.protection_m)
        if self._keep_beams:
            self._beams.append(says.p_unknown.astype(np.float32))
        unknown_ends = ends[:, says.unknown]
        if says.p_success < _TRUSTED or unknown_ends.shape[1] == 0:
            return
        at = compose(pose[None], np.column_stack([unknown_ends.T.astype(np.float64), np.zeros(unknown_ends.shape[1])]))
        x, y, yaw = self._grid.origin
        c, s = np.cos(yaw), np.sin(yaw)
        dx, dy = at[:, 0] - x, at[:, 1] - y
        cols = np.floor((c * dx + s * dy) / self._grid.resolution_m).astype(np.int64)
        rows = np.floor((-s * dx + c * dy) / self._grid.resolution_m).astype(np.int64)
        height, width = self._grid.cells.shape
        inside = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
        cells = np.unique(rows[inside] * width + cols[inside])
        self._counts[cells] = np.minimum(self._counts[cells] + 1, 65535)

    def p_success_at_end(self) -> float:
        """Of the last update."""
        return float(self._p_success.last())

    def columns(self) -> dict[str, NDArray[Any]]:
        """Columns of the track."""
        return {"p_success": self._p_success.array(), "protection_m": self._protection.array()}

    def beams(self) -> dict[str, Any]:
        """p(unknown) of every used beam, per update."""
        return {"t_ns": self._stamps_ns.array(), "p_unknown": self._beams}

    def layer(self) -> GridMap:
        """Cells in which unknown obstacles were seen at least twice, on the map's grid."""
        return self._grid._replace(
            cells=np.where(self._counts >= _SEEN_TWICE, 1, 0).reshape(self._grid.cells.shape).astype(np.int8)
        )

    def recoveries(self) -> list[dict[str, float]]:
        """When the robot was lost and found itself: p(success) fell below 0.5, or the estimate left the place that odometry
        predicted, until p(success) is at least 0.5 again. lost_s: since the first update; moved_m: size of the jump."""
        found: list[dict[str, float]] = []
        sure, lost, moved = False, -1, 0.0
        stamps, jumps = self._stamps_ns.array().tolist(), self._jumps_m.array().tolist()
        for k, p in enumerate(self._p_success.array().tolist()):
            moved = max(moved, jumps[k]) if lost >= 0 else jumps[k]
            jumped = jumps[k] > MODE_M
            if lost < 0 and sure and (p < 0.5 or jumped):
                lost = k if p < 0.5 else k - 1
            if lost >= 0 and p >= 0.5:
                since, after = (stamps[i] - stamps[j] for i, j in ((lost, 0), (k, lost)))
                row = {"lost_s": round(since * 1e-9, 3), "after_s": round(after * 1e-9, 3), "moved_m": round(moved, 3)}
                found.append(row)
                lost = -1
            sure = p >= 0.5
        return found
