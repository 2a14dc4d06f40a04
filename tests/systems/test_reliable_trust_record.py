"""Places that were trusted and given up: how far the word of localize-reliable can be taken."""

from pathlib import Path

import numpy as np
import pytest

from pfcli.initial import Initial
from pfcli.params import build
from pfcli.registry import system
from pfcli.runs import loop
from pfcli.simulation import indoor_world, scenario
from pfcli.systems.localize_reliable import trust_record
from pfcli.systems.localize_reliable.trust_record import NOTHING, TrackRecord


def _left(ways: list[float], trust: float = 1.0) -> TrackRecord:
    """The record after places that were kept for these ways (m)."""
    record, at = NOTHING, 0.0
    for way in ways:
        record = trust_record.trusted(record, trust, 0.1)
        at += way
        record = trust_record.given_up(record, at)
    return record


def test_precision_equals_the_sum_over_all_labels() -> None:
    """Every place is right or wrong: summed over all labellings and shares, beside the mixture that the filter keeps."""
    ways, kept = [1.0, 30.0, 4.0], 2.0
    life = np.exp(
        -np.array([1.0 / trust_record._RIGHT_M, 1.0 / trust_record._WRONG_M]) * np.array([*ways, kept])[:, None]
    )
    density = life / [trust_record._RIGHT_M, trust_record._WRONG_M]
    total = np.zeros(2)
    for share, prior in zip(trust_record._SHARE, trust_record._PRIOR, strict=True):
        label = np.array([share, 1.0 - share])
        for labels in np.ndindex(2, 2, 2, 2):
            p = prior * np.prod(label[list(labels)])
            total[labels[3]] += p * np.prod([density[k, labels[k]] for k in range(3)]) * life[3, labels[3]]
    record = _left(ways)
    assert trust_record.precision(record, record.since_m + kept) == pytest.approx(total[0] / total.sum(), rel=1e-9)


def test_a_filter_is_believed_until_it_has_been_wrong() -> None:
    assert trust_record.precision(NOTHING, 0.0) == pytest.approx(0.98, abs=1e-3)
    assert trust_record.precision(NOTHING, 4.0) > 0.99
    assert trust_record.precision(trust_record.TOLD, 0.0) > 0.9999
    often_carried = _left([30.0] * 20)  # a right place is kept until somebody carries the robot
    assert trust_record.precision(often_carried, often_carried.since_m) > 0.97
    never_trusted = _left([1.0] * 20, trust=0.0)
    assert trust_record.precision(never_trusted, never_trusted.since_m) > 0.97
    wrong = _left([2.0] * 6)
    at_once, later, after_all = (trust_record.precision(wrong, wrong.since_m + way) for way in (0.0, 5.0, 40.0))
    assert at_once < 0.3
    assert at_once < later < after_all
    assert after_all > 0.99
    for way in (1e5, 1e9):  # hours of driving, or a leap of the odometry
        assert trust_record.precision(NOTHING, way) == pytest.approx(1.0)
        assert trust_record.precision(_left([way]), way) == pytest.approx(0.98, abs=1e-3)


def test_who_has_to_give_up_place_after_place_trusts_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot carried every 2 m looks to the filter as a wrong map does: scans fit, and the place does not last."""
    monkeypatch.setitem(
        indoor_world.WORLDS, "often", lambda seed: indoor_world.carried(indoor_world.office(1), seed, 40, 2.0)
    )
    log = tmp_path / "often.mcap"
    found = scenario.Scenario("often", "often", duration_s=110.0, rate_hz=2.5, odometry_hz=5.0)
    scenario.write(found, 3, log)
    scenario.write_map(found, tmp_path, "often")
    reliable = system("localize-reliable")
    said = {}
    for counts in (True, False):
        params = build(reliable.params, {"track_record": counts}, "test")
        job = loop.Job(reliable, params, [log], 1, map=tmp_path / "often.yaml", initial=Initial("inside"))
        said[counts] = loop.execute(job)
    p = {counts: np.array([row.p_success for row in done.infos]) for counts, done in said.items()}
    precision = np.array([row.precision for row in said[True].infos])
    half = precision.size // 2
    assert np.median(p[False][half:]) > 0.5
    assert np.median(precision[half:]) < 0.5
    assert p[True] == pytest.approx(p[False] * precision, abs=1e-9)
    assert (said[True].result.track.poses == said[False].result.track.poses).all()
