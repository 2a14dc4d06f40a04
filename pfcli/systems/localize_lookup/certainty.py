"""Since when the filter is certain of its place, and how often it had to take that back."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core import estimate
from pfcli.core.estimate import PoseEstimate

MODE_M, MODE_RAD = 0.75, 0.5
"""Poses within this of each other are one hypothesis."""
_CERTAIN, _CERTAIN_M, _DOUBTFUL = 0.8, 0.3, 0.5
"""Certain: so much of the mass in one hypothesis of at most this deviation; doubtful: less than this share of the mass."""


class Certainty(NamedTuple):
    """Stamps (ns) since which the filter is certain, and when it first was, -1 for not; how often it was withdrawn."""

    since_ns: int = -1
    first_ns: int = -1
    withdrawn: int = 0


def after(
    before: Certainty, found: PoseEstimate, expected: NDArray[np.float64] | None, looked: bool, stamp_ns: int
) -> Certainty:
    """After an estimate. expected: (3,) where odometry expected it, None at the start; looked: readings fitted so badly that
    places all over the map were tried.

    Certainty is withdrawn with a look around, with a jump to another place, or where half of the mass is elsewhere. It may come
    back at the next update.
    """
    jumped = expected is not None and not estimate.members(expected[None], found.pose, MODE_M, MODE_RAD)[0]
    if looked or jumped or found.mass < _DOUBTFUL:
        return before._replace(since_ns=-1, withdrawn=before.withdrawn + int(before.since_ns >= 0))
    if before.since_ns >= 0 or found.mass < _CERTAIN or found.sd_m > _CERTAIN_M:
        return before
    return before._replace(since_ns=stamp_ns, first_ns=before.first_ns if before.first_ns >= 0 else stamp_ns)


def summary(certainty: Certainty, began_ns: int) -> dict[str, float | int | None]:
    """For `run.json`: seconds since the start at which certainty began, first and for good, null where there is none."""

    def seconds(stamp_ns: int) -> float | None:
        return None if stamp_ns < 0 else round((stamp_ns - began_ns) * 1e-9, 3)

    return {
        "certain_since_s": seconds(certainty.since_ns),
        "first_certain_s": seconds(certainty.first_ns),
        "certainty_withdrawn": certainty.withdrawn,
    }
