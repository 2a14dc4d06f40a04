"""How far the filter's own word can be taken: which share of the places that it trusted were right?

In a wrong map scans fit here and there, and the decision model is content with each for some metres: what gives such a
map away is that one trusted place after the other is left again. A right place is left after `_RIGHT_M` on average
(somebody carries the robot), a wrong one after `_WRONG_M`, both exponentially; the share of right ones is not known, but
high unless the lifetimes of the places so far say otherwise. So a place that was just found is not yet as sure as one that
was kept for metres.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_RIGHT_M, _WRONG_M = 100.0, 4.5
_AGAIN_M = 1.5
"""Way for which a place must be trusted again after the robot may have been carried."""
_SHARE = np.append((np.arange(50) + 0.5) / 50.0, 0.98)
"""Shares of right places among the trusted ones that are thought possible: in wrong maps any, in right ones the last."""
_PRIOR = np.append(np.full(50, 0.001 / 50.0), 0.999)


class TrackRecord(NamedTuple):
    """log_p (51,): of each possible share, up to a constant; since_m: way at which the present place was taken; trust: the
    highest p(success) that it was given; trusted_m: the way for which it was trusted, by p(success)."""

    log_p: NDArray[np.float64]
    since_m: float
    trust: float
    trusted_m: float


NOTHING = TrackRecord(np.log(_PRIOR), 0.0, 0.0, 0.0)
TOLD = NOTHING._replace(since_m=-_RIGHT_M, trusted_m=_RIGHT_M)
"""The first place was not found but told: as if it had been kept for long."""


def given_up(record: TrackRecord, way_m: float) -> TrackRecord:
    """The present place is left at way_m for another one; its lifetime counts as far as it was trusted."""
    wrong = (1.0 - _SHARE) * _faded(record, way_m) / _WRONG_M
    log_p = record.log_p + record.trust * np.log(_SHARE / _RIGHT_M + wrong)
    return TrackRecord(log_p - log_p.max(), way_m, 0.0, 0.0)


def trusted(record: TrackRecord, p_success: float, step_m: float) -> TrackRecord:
    """The decision model gives the present place p_success, after a step of step_m."""
    return record._replace(trust=max(record.trust, p_success), trusted_m=record.trusted_m + p_success * step_m)


def doubted(record: TrackRecord) -> TrackRecord:
    """The robot may have been carried: the place must be trusted again for a while."""
    return record._replace(trusted_m=min(record.trusted_m, _WRONG_M - _AGAIN_M))


def outlasts_wrong(record: TrackRecord) -> bool:
    """Whether the present place was trusted for as long as a wrong one is on average."""
    return record.trusted_m >= _WRONG_M


def precision(record: TrackRecord, way_m: float) -> float:
    """P(a trusted place that was kept until way_m is right)."""
    p = np.exp(record.log_p)
    share = float(p @ _SHARE / p.sum())
    return share / (share + (1.0 - share) * _faded(record, way_m))


def _faded(record: TrackRecord, way_m: float) -> float:
    """P(a wrong place is kept until way_m), by that of a right one."""
    return float(np.exp(-max(0.0, way_m - record.since_m) * (1.0 / _WRONG_M - 1.0 / _RIGHT_M)))
