"""A chain of poses, each right as seen from those a few metres before: odometry by scans, and how sure it is of each step."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import between, wrap
from pfcli.core.graph.pose_graph import Edges, seen_from, softened
from pfcli.core.grid import tiles
from pfcli.core.grid.scan_odometry import TURN_M, ScanOdometry, Setup
from pfcli.core.motion.odometry import Noise, standard_deviations
from pfcli.core.motion.odometry_calibration import calibrate

_STEP_SD = (0.005, 0.005, 0.001)
"""What a match errs by beyond its own information (m, m, rad)."""
_SIGMAS, _LEAST, _BESIDE = 3.0, (0.05, 0.05, 0.03), 2
"""A step of another path is far off from so many standard deviations of the odometry on, and so much (m, m, rad); and so many
steps beside it may have slipped too."""


class Chain(NamedTuple):
    """poses (t, 3), each right as seen from those a few metres before; fits (t,): scans that do not contradict what is drawn at
    those; edges between successive poses."""

    poses: NDArray[np.float64]
    fits: NDArray[np.bool_]
    edges: Edges

    def steps(self) -> NDArray[np.float64]:
        """Steps (t - 1, 3) from pose to pose (m, m, rad)."""
        return self.edges.measured


def way_of(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Way (t,) at each pose of so many steps (t - 1, 3), a turn counting too (m)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + TURN_M * np.abs(steps[:, 2]))])


def chained(
    scans: list[tiles.Beams], steps: NDArray[np.float64], noise: Noise, setup: Setup, slips: NDArray[np.bool_]
) -> Chain:
    """Match each scan against the map of the way behind it.

    noise: of the steps (t - 1, 3) while the wheels do not slip; slips (t - 1,): where they may.
    """
    count = len(scans)
    way = way_of(steps)
    poses, information, fits = np.zeros((count, 3)), np.empty((count - 1, 3, 3)), np.ones(count, np.bool_)
    behind = ScanOdometry(setup, scans[0], poses[0])
    for k in range(1, count):
        step = steps[k - 1], way[k] - way[k - 1], noise, bool(slips[k - 1])
        poses[k], information[k - 1], fits[k] = behind.step(scans[k], *step)
    first = np.arange(count - 1)
    told = softened(seen_from(poses[:-1, 2], information), _STEP_SD)
    return Chain(poses, fits, Edges(first, first + 1, between(poses[:-1], poses[1:]), told))


def slips_of(steps: NDArray[np.float64], known: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Where wheels may have slipped (t - 1,): another path, of steps known (t - 1, 3), is far off the odometry there, or beside.

    People who walk along with the robot look like a slip to a map of a few metres of way, not to one of the whole.
    """
    calibration = calibrate(steps, known)
    if calibration is None:
        return np.ones(len(steps), np.bool_)
    noise = calibration.noise()
    sd = np.array([standard_deviations(step, noise) for step in steps]).reshape(-1, 3)
    off = known - calibration.corrected(steps)
    off[:, 2] = wrap(off[:, 2])
    far = (np.abs(off) > _SIGMAS * sd + np.array(_LEAST)).any(axis=1)
    return np.convolve(far, np.ones(2 * _BESIDE + 1), "same") > 0
