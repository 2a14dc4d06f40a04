"""Wheels, the place and the clock of a sensor, from any drive."""

import numpy as np
import pytest

from pfcli.core.geometry import between, compose
from pfcli.core.motion.drive_calibration import Motions, Rolling, calibrate

TRUE = np.array([1.02, 0.98, 1.04, 0.23, -0.12, 0.2, -0.15])
"""Scales of the wheels and of the track, sensor, seconds."""
TRACK_M = 0.4


def drive(rates: np.ndarray, rng: np.random.Generator, noise: float) -> tuple[Motions, Rolling]:
    """A drive at 0.5 m/s with these turn rates (rad/s, every 0.02 s); noise: of each wheel per root of a metre (m)."""
    t = np.arange(rates.size + 1) * 0.02
    ahead = np.full(rates.size, 0.01)
    turn = rates * 0.02
    yaw = np.concatenate([[0.0], np.cumsum(turn)])
    x = np.concatenate([[0.0], np.cumsum(ahead * np.cos(yaw[:-1] + turn / 2))])
    y = np.concatenate([[0.0], np.cumsum(ahead * np.sin(yaw[:-1] + turn / 2))])
    track = TRACK_M * TRUE[2]
    wheels = np.stack([(ahead - turn * track / 2) / TRUE[0], (ahead + turn * track / 2) / TRUE[1]], axis=1)
    wheels += noise * np.sqrt(np.abs(wheels)) * rng.standard_normal(wheels.shape)
    rolled = np.concatenate([np.zeros((1, 2)), np.cumsum(wheels, axis=0)])
    start = np.arange(1.0, t[-1] - 2.0, 0.3)
    first, last = (np.stack([np.interp(s, t, v) for v in (x, y, yaw)], axis=1) for s in (start, start + 0.3))
    mount = TRUE[3:6].reshape(1, 3)
    step = between(compose(first, mount), compose(last, mount)) + 1e-3 * rng.standard_normal((start.size, 3))
    return Motions(start - TRUE[6], start + 0.3 - TRUE[6], step), Rolling(t, rolled, TRACK_M)


GIVEN = np.array([1.0, 1.0, 1.0, 0.3, 0.0, 0.0, 0.0])


def test_everything_is_found_of_a_drive_that_turns() -> None:
    rng = np.random.default_rng(3)
    rates = np.repeat(rng.choice([-0.8, 0.0, 0.0, 0.8], 300), 50)
    found = calibrate(*drive(rates, rng, 0.004), GIVEN)
    assert found is not None
    assert found.told.all()
    assert (np.abs(found.value - TRUE) < 5 * found.sd).all()
    assert np.abs(found.value[:3] / TRUE[:3] - 1).max() < 0.005
    assert np.abs(found.value[3:5] - TRUE[3:5]).max() < 0.01
    assert abs(found.value[5] - TRUE[5]) < np.radians(0.3)
    assert abs(found.value[6] - TRUE[6]) < 0.005


def test_what_a_straight_drive_does_not_tell_is_left_as_given() -> None:
    rng = np.random.default_rng(4)
    found = calibrate(*drive(np.zeros(6000), rng, 0.002), GIVEN)
    assert found is not None
    told = dict(zip(("left", "right", "track", "x", "y", "yaw", "seconds"), found.told.tolist(), strict=True))
    assert not any(told[name] for name in ("track", "x", "y", "seconds"))
    assert found.value[2:5] == pytest.approx(GIVEN[2:5])


def test_too_short_a_drive_tells_nothing() -> None:
    assert (
        calibrate(Motions(*np.zeros((2, 5)), np.zeros((5, 3))), Rolling(np.arange(9.0), np.zeros((9, 2)), 0.4), GIVEN)
        is None
    )
