"""What the filter keeps between two frames, and a frame on its way through an update."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.sensor import compass
from pfcli.events import Sighting
from pfcli.rng import Draw
from pfcli.systems.fuse_soccer.field_assets import Assets, View
from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.fuse_soccer.sighting_likelihood import Belief, Heard
from pfcli.systems.shared.frame_keeper import FrameKeeper
from pfcli.systems.shared.track_keeper import TrackKeeper

_CAUTIOUS = 20.0
"""The motion's variance at the start, in units of its parameters."""


class State(NamedTuple):
    """belief: particles; pose: (3,) the last estimate; last: sighting; begun_yaw_rad: odometry at the first one; bias of the
    compass; heard_ns: its last reading, 0 before; stretch: of the motion's variance; fit: evidence of the last frames and the
    best there could be, both fading; what the end needs."""

    belief: Belief
    pose: NDArray[np.float64]
    last: Sighting
    begun_yaw_rad: float
    bias: compass.Bias
    heard_ns: int
    stretch: float
    fit: tuple[float, float]
    way_m: float
    track: TrackKeeper
    frames: FrameKeeper
    mirror_p: list[float]
    certain_ns: list[int]
    injected_ns: list[int]


def init(params: Params, assets: Assets, first: Sighting, draw: Draw) -> State:
    """Nothing is known before the first frame."""
    adapts = params.adapt and params.vision and params.refine > 0.0 and params.variant == "corrected"
    return State(
        belief=Belief(np.empty((0, 3)), np.empty(0), np.empty(0)),
        pose=np.zeros(3),
        last=first,
        begun_yaw_rad=first.odometry[2],
        bias=compass.Bias(),
        heard_ns=0,
        stretch=_CAUTIOUS if adapts else 1.0,
        fit=(1.0, 1.0),
        way_m=0.0,
        track=TrackKeeper(),
        frames=FrameKeeper(),
        mirror_p=[],
        certain_ns=[],
        injected_ns=[],
    )


class Glance(NamedTuple):
    """A frame on its way through an update; slip_m, surprise, injected and refined: see `Info` and `line_proposal.beside`."""

    sighting: Sighting
    view: View
    heard: Heard | None
    seconds: float
    slip_m: float = 0.0
    surprise: float = 1.0
    refined: int = 0
    injected: int = 0
