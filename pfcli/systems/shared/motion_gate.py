"""The step between two updates: how far the robot has moved, whether that is far enough, and how uncertain it is."""

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between
from pfcli.core.motion.odometry import Noise, standard_deviations
from pfcli.events import Sighting, Sounding, Sweep

Reading = TypeVar("Reading", bound=Sweep | Sounding | Sighting)
Used = TypeVar("Used")


class Step(NamedTuple):
    """now: (1, 3) odometry; moved: (3,) step since the last update in its base frame (m, m, rad); way_m: its length;
    far: far enough for an update."""

    now: NDArray[np.float64]
    moved: NDArray[np.float64]
    way_m: float
    far: bool


def step_since(last: NDArray[np.float64], odometry: tuple[float, float, float], params: Any) -> Step:
    """The step from the odometry (1, 3) of the last update. params: of any system, with `update_distance_m` and `_angle_rad`."""
    now = np.array([odometry], np.float64)
    moved = between(last, now)[0]
    way = float(np.hypot(moved[0], moved[1]))
    far = way >= params.update_distance_m or abs(moved[2]) >= params.update_angle_rad
    return Step(now, moved, way, bool(far))


class Record(Protocol):
    """What records the readings of a run and counts its updates."""

    def see(self, reading: Any) -> None:
        """Record a reading."""

    @property
    def updates(self) -> int:
        """Updates so far."""


class Update(NamedTuple, Generic[Used]):
    """A reading that updates the filter: whether it is the first, the step since the last one, and what of it is used."""

    first: bool
    step: Step
    used: Used


def update_of(
    record: Record,
    last: NDArray[np.float64],
    reading: Reading,
    params: Any,
    usable: Callable[[Reading, Any], Used | None],
) -> Update[Used] | None:
    """Record a reading. It updates the filter if it is the first, or if the robot has moved far enough since the odometry (1, 3)
    of the last update, and if any of it is usable; else None.

    params: see `step_since`; usable: what of a reading is used, None where nothing is.
    """
    record.see(reading)
    first, step = record.updates == 0, step_since(last, reading.odometry, params)
    if not (first or step.far):
        return None
    used = usable(reading, params)
    return None if used is None else Update(first, step, used)


def noise_of(params: Any) -> Noise:
    """The odometry's errors as the core takes them. params: of any system, with the `motion_*` fields."""
    return Noise(
        xy_per_m=params.motion_xy_per_m,
        xy_per_rad_m=params.motion_xy_per_rad_m,
        xy_m=params.motion_xy_m,
        yaw_per_rad=params.motion_yaw_per_rad,
        yaw_per_m_rad=params.motion_yaw_per_m_rad,
        yaw_rad=params.motion_yaw_rad,
    )


def step_noise(moved: NDArray[np.float64], params: Any) -> NDArray[np.float64]:
    """(3,) standard deviations of a step (m, m, rad)."""
    return np.asarray(standard_deviations(moved, noise_of(params)))
