"""What every system hands over at the end of a run."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid.grid_map import GridMap
from pfcli.dropped import Loss


class Track(NamedTuple):
    """Pose of every scan: stamps (n,) ns, poses (n, 3) m, rad; columns: more of equal length."""

    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    columns: dict[str, Any]


class Frame(NamedTuple):
    """One drawn update: estimate (NaN where there is none), particles (k, 3), their classes uint8 (k,; 0 where the system
    has none), and the scan's end points in the base frame (b, 2), m."""

    stamp_ns: int
    pose: NDArray[np.float64]
    particles: NDArray[np.float64]
    labels: NDArray[np.uint8]
    scan_m: NDArray[np.float64]


class Result(NamedTuple):
    """track; grid: the map that was built or localised in; frames; summary: scalars for run.json; layers: more maps by
    name; tables: more tables by name, columns of equal length; texts: more files by
    name; given_frame: poses are in the frame of a map or field that was given, not in one of the system's own;
    loss: what the system itself left out or doubts."""

    track: Track
    grid: GridMap | None
    frames: list[Frame]
    summary: dict[str, Any]
    layers: Mapping[str, GridMap] = MappingProxyType({})
    tables: Mapping[str, dict[str, Any]] = MappingProxyType({})
    texts: Mapping[str, str] = MappingProxyType({})
    given_frame: bool = False
    loss: Loss | None = None
