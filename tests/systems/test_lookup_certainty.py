"""Being certain of a place, and taking that back."""

import numpy as np

from pfcli.core.estimate import PoseEstimate
from pfcli.systems.localize_lookup import certainty
from pfcli.systems.localize_lookup.certainty import Certainty


def _found(x: float, mass: float = 0.9, sd_m: float = 0.1) -> PoseEstimate:
    return PoseEstimate(np.array([x, 0.0, 0.0]), np.diag([sd_m**2, 0.0, 0.0]), mass)


def _after(known: Certainty, x: float, stamp_ns: int, looked: bool = False, mass: float = 0.9) -> Certainty:
    return certainty.after(known, _found(x, mass), np.array([1.0, 0.0, 0.0]), looked, stamp_ns)


def test_certainty_begins_with_one_narrow_hypothesis() -> None:
    for mass, sd_m, expected in ((0.9, 0.1, 5), (0.7, 0.1, -1), (0.9, 0.4, -1)):
        assert certainty.after(Certainty(), _found(0.0, mass, sd_m), None, False, 5).since_ns == expected


def test_a_look_a_jump_and_a_lost_majority_withdraw_it_and_a_weak_one_does_not() -> None:
    known = Certainty(since_ns=5, first_ns=5)
    assert _after(known, 1.1, 9) == known
    assert _after(known, 1.1, 9, mass=0.6) == known
    for doubt in (_after(known, 1.1, 9, looked=True), _after(known, 3.0, 9), _after(known, 1.1, 9, mass=0.4)):
        assert doubt == Certainty(since_ns=-1, first_ns=5, withdrawn=1)
        assert _after(doubt, 3.0, 10) == doubt  # withdrawn once
        back = _after(doubt, 1.0, 12)
        assert back == Certainty(since_ns=12, first_ns=5, withdrawn=1)
    said = certainty.summary(Certainty(2_500_000_000, 1_000_000_000, 1), 500_000_000)
    assert said == {"certain_since_s": 2.0, "first_certain_s": 0.5, "certainty_withdrawn": 1}
    assert certainty.summary(Certainty(), 0)["certain_since_s"] is None
