"""How a log is read, and what rolls under the robot: what options and sweeps are made of."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.errors import UsageError
from pfcli.formats.limits import Limits

SOURCES = ("auto", "odometry", "odometry-twist", "encoders", "twist", "imu")
"""Where motion comes from; imu: yaw rate of the gyroscope with the speed of wheels, twist or odometry."""

BASES = ("differential", "omni", "mecanum")
_CORNERS = (("front", "left"), ("front", "right"), ("rear", "left"), ("rear", "right"))

RANGES = ("distance", "depth")
"""What a landmark's range is: how far away it is, or how far ahead, as a camera's lens measures it by the size in the image."""


class Drive(NamedTuple):
    """A wheel base. base: `differential` (track_m), `omni` (arm_m from the centre; angle_deg: the paper's phi of four
    wheels, or the bearing of each wheel) or `mecanum` (track_m, axles_m apart). joints: of the wheels, in the base's order;
    radius_m: one for all, or one for each; ticks_per_turn: of joints whose position counts ticks (0: it is in rad)."""

    base: str = "differential"
    joints: tuple[str, ...] | None = None
    radius_m: tuple[float, ...] = ()
    track_m: float = 0.0
    axles_m: float = 0.0
    arm_m: float = 0.0
    angle_deg: tuple[float, ...] = ()
    ticks_per_turn: float = 0.0

    @property
    def sides(self) -> tuple[tuple[str, ...], ...]:
        """Words that tell the wheels of this base by their joints' names, in order; empty where names do not tell."""
        if self.base == "differential":
            return (("left",), ("right",))
        if self.base == "mecanum":
            return _CORNERS
        return tuple(_CORNERS[k] for k in (2, 0, 1, 3)) if len(self.angle_deg) == 1 else ()

    def jacobian(self) -> "NDArray[np.float64]":
        """Travel of each wheel per step of the robot. Raises UsageError naming the flag whose value is missing."""
        # kernels are imported where they run: the options of a command are made of this module
        from pfcli.core.motion import wheels

        needed = {
            "differential": [("--track-width-m", self.track_m)],
            "omni": [("--wheel-arm-m", self.arm_m), ("--wheel-angle-deg", float(len(self.angle_deg)))],
            "mecanum": [("--track-width-m", self.track_m), ("--axle-distance-m", self.axles_m)],
        }[self.base]
        missing = [
            name for name, value in [("--wheel-radius-m", min(self.radius_m, default=0.0)), *needed] if value <= 0
        ]
        if missing:
            others = "; other wheels: --base" if self.base == BASES[0] else ""
            raise UsageError(
                f"motion from encoders needs {' and '.join(missing)} (> 0) of the {self.base} base{others}, or a --drive file"
            )
        if self.base == "differential":
            return wheels.differential(self.track_m)
        if self.base == "mecanum":
            return wheels.mecanum(self.axles_m / 2, self.track_m / 2)
        bearings = [math.radians(a) for a in self.angle_deg]
        if len(bearings) == 1:
            if not 0.0 < self.angle_deg[0] < 90.0:
                raise UsageError(
                    "--wheel-angle-deg: the angle of four wheels lies between 0 and 90; or give one per wheel"
                )
            bearings = list(wheels.four_places(bearings[0]))
        if len(bearings) < 3:
            raise UsageError("--wheel-angle-deg: an omni base has three wheels or more; give the bearing of each")
        found = wheels.omni(bearings, [self.arm_m] * len(bearings))
        if np.linalg.matrix_rank(found) < 3:
            raise UsageError(
                "--wheel-angle-deg: wheels at these bearings cannot tell every motion; three different are needed"
            )
        return found


class Image(NamedTuple):
    """What turns pixels of an omnidirectional camera into metres (Zhang 2011, eq. (5)): scale (pixels per cm) and centre
    (pixels); up in the image is ahead."""

    px_per_cm: float
    centre_px: tuple[float, float]

    def metres(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (n, 2) of the image (right, down) in the robot's frame (ahead, left)."""
        ahead = self.centre_px[1] - points_px[:, 1]
        left = self.centre_px[0] - points_px[:, 0]
        return np.column_stack([ahead, left]) / (100.0 * self.px_per_cm)


class Band(NamedTuple):
    """Heights above the floor (m) between which things are walls."""

    low_m: float = 0.1
    high_m: float = 2.0


STAMPS = ("first", "middle", "last")
"""Which beam a scan's stamp is of."""


class Deskew(NamedTuple):
    """How beams are placed by the motion at their own time. duration_s: of a scan, None: as the log says; stamp: one of
    `STAMPS`; by_scan_time: a scan without times between its beams is swept in its share of `scan_time`."""

    on: bool = True
    duration_s: float | None = None
    stamp: str = STAMPS[0]
    by_scan_time: bool = False


AS_TOLD = Deskew()


class Settings(NamedTuple):
    """How a log is read: role -> topic, clock, window (s from the log's first stamp), offsets (s), extrinsics, the image of
    vision that gives pixels, what landmarks' ranges are (one of `RANGES`), limits, the base frame and the robot's namespace
    ('': what the log says), the heights that are walls (None: what the log tells), how scans are de-skewed, whether the offset
    of the scans' clock is estimated, a shade of the map that is unknown whatever its thresholds say,
    and windows (s) that are left out."""

    topics: Mapping[str, str] = {}
    clock: str = "header"
    start_s: float | None = None
    end_s: float | None = None
    reorder_s: float = 2.0
    offsets_s: Mapping[str, float] = {}
    extrinsics: Sequence[str] = ()
    image: Image | None = None
    landmark_ranges: str = RANGES[0]
    limits: Limits = Limits()
    base_frame: str = ""
    robot: str = ""
    band: Band | None = None
    deskew: Deskew = Deskew()
    estimate_offset: bool = False
    truth_lever_m: tuple[float, float] = (0.0, 0.0)
    unknown_grey: int | None = None
    cuts: Sequence[tuple[float, float]] = ()
