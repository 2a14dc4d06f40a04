"""What a log says, as one NamedTuple per kind of reading: SI units, the robot's base frame, read-only arrays."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


def stamp_text(stamp_ns: int) -> str:
    """A stamp as text, `seconds.nanoseconds`, exact."""
    seconds, rest = divmod(stamp_ns, 1_000_000_000)
    return f"{seconds}.{rest:09d}"


class Pose2(NamedTuple):
    """A pose in the plane (m, m, rad); as a mount: the sensor seen from base_link."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0


class Odometry(NamedTuple):
    """Pose in the odometry frame; the twist, or the heading, is NaN where the log has none."""

    stamp_ns: int
    x_m: float
    y_m: float
    yaw_rad: float
    vx_mps: float = float("nan")
    vy_mps: float = float("nan")
    yaw_rate_radps: float = float("nan")


class Twist(NamedTuple):
    """Velocity in the base frame."""

    stamp_ns: int
    vx_mps: float
    vy_mps: float
    yaw_rate_radps: float


class Steering(NamedTuple):
    """A car's speed at its rear axle (m/s) and the angle of its front wheels (rad, positive to the left)."""

    stamp_ns: int
    speed_mps: float
    angle_rad: float


class Wheels(NamedTuple):
    """Wheel angles (rad, cumulative) and speeds (rad/s), NaN where the log has none; names in the log's order."""

    stamp_ns: int
    names: tuple[str, ...]
    position_rad: NDArray[np.float64]
    velocity_radps: NDArray[np.float64]


class Ticks(NamedTuple):
    """Encoder ticks, cumulative or per cycle as the message says."""

    stamp_ns: int
    names: tuple[str, ...]
    ticks: NDArray[np.int64]
    ticks_per_turn: float
    cumulative: bool


class Heading(NamedTuple):
    """Absolute heading of the robot, counter-clockwise from x (rad), with its standard deviation (NaN if not given).

    Of a magnetic field: x is east.
    """

    stamp_ns: int
    yaw_rad: float
    sigma_rad: float


class YawRate(NamedTuple):
    """Turn rate of a gyroscope (rad/s)."""

    stamp_ns: int
    yaw_rate_radps: float


EVENLY: NDArray[np.float64] = np.empty(0)
"""Bearings of a scan whose beams are evenly spaced."""


class Scan(NamedTuple):
    """A laser scan; beam i points at angle_min_rad + i angle_increment_rad in the sensor frame, or at bearings_rad[i] where
    beams are not evenly spaced. time_increment_s: between two beams; scan_time_s: between two scans; 0 where the log does
    not say."""

    stamp_ns: int
    ranges_m: NDArray[np.float32]
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    mount: Pose2
    bearings_rad: NDArray[np.float64] = EVENLY
    time_increment_s: float = 0.0
    scan_time_s: float = 0.0
    topic: str = ""

    def angles_rad(self, every: int = 1) -> NDArray[np.float64]:
        """Bearings of every `every`-th beam in the sensor frame."""
        if self.bearings_rad.size:
            return self.bearings_rad[::every]
        return np.asarray(self.angle_min_rad + self.angle_increment_rad * np.arange(0, self.ranges_m.size, every))

    def directions_rad(self) -> NDArray[np.float64]:
        """Bearings of the beams in the base frame."""
        if self.bearings_rad.size:
            return np.asarray(self.mount.yaw_rad + self.bearings_rad)
        first = self.mount.yaw_rad + self.angle_min_rad
        return np.asarray(first + self.angle_increment_rad * np.arange(self.ranges_m.size))


class Range(NamedTuple):
    """One range finder's reading (m)."""

    stamp_ns: int
    topic: str
    range_m: float
    range_min_m: float
    range_max_m: float
    mount: Pose2


class Ranges(NamedTuple):
    """One reading of each range finder: ranges (k,) m, mounts (k, 3), the least and the largest range (m) of each."""

    stamp_ns: int
    ranges_m: NDArray[np.float32]
    mounts: NDArray[np.float64]
    range_min_m: NDArray[np.float32]
    range_max_m: NDArray[np.float32]


class Sweep(NamedTuple):
    """A scan with the odometry pose of its own stamp, and the stamp text of the log it was converted from ('' if none)."""

    stamp_ns: int
    odometry: tuple[float, float, float]
    scan: Scan
    source_stamp: str


class Sounding(NamedTuple):
    """A reading of all range finders with the odometry pose of its stamp."""

    stamp_ns: int
    odometry: tuple[float, float, float]
    ranges: Ranges
    source_stamp: str = ""


class LinePoints(NamedTuple):
    """Points of field lines, (n, 2) in the base frame (m); pixels: as decoded, before the image's scale is applied."""

    stamp_ns: int
    points_m: NDArray[np.float64]
    pixels: bool = False


class Landmarks(NamedTuple):
    """Detected landmarks: id (n,), range (n,) m, bearing (n,) rad, standard deviations (n, 2), NaN if not given.

    pixels: as decoded, before the image's scale is applied.
    """

    stamp_ns: int
    ids: tuple[str, ...]
    range_m: NDArray[np.float64]
    bearing_rad: NDArray[np.float64]
    sigma: NDArray[np.float64]
    pixels: bool = False


class Rolling(NamedTuple):
    """How far each wheel has rolled since the first message: rolled (2, k), with its sign and without (m); jacobian (k, 3)
    of the base: travel of each wheel per step of the robot; back (3, k): its pseudo-inverse."""

    rolled_m: NDArray[np.float64]
    jacobian: NDArray[np.float64]
    back: NDArray[np.float64]


class Sighting(NamedTuple):
    """What vision saw at a stamp, with the odometry pose of that stamp: points of field lines (n, 2) in the base frame (m),
    detected landmarks, the newest reading of the compass, and the wheels where motion comes from encoders; travelled: way (m)
    and turn (rad) since the first odometry, without signs."""

    stamp_ns: int
    odometry: tuple[float, float, float]
    points_m: NDArray[np.float64]
    landmarks: tuple["Landmarks", ...]
    compass: "Heading | None" = None
    rolling: Rolling | None = None
    travelled: tuple[float, float] = (0.0, 0.0)
    source_stamp: str = ""


class Truth(NamedTuple):
    """True pose of base_link in the map frame; the heading is NaN where the reference has none."""

    stamp_ns: int
    x_m: float
    y_m: float
    yaw_rad: float


class SourceStamp(NamedTuple):
    """The stamp text of the log that a scan was converted from."""

    stamp_ns: int
    text: str


Event = (
    Odometry
    | Twist
    | Steering
    | Wheels
    | Ticks
    | Heading
    | YawRate
    | Scan
    | Range
    | Ranges
    | LinePoints
    | Landmarks
    | Sighting
    | Truth
    | SourceStamp
)
