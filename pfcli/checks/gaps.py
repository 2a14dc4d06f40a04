"""W106: a topic pauses."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.events import stamp_text
from pfcli.findings import Finding

_SHORTEST_S, _TIMES = 2.0, 10.0
_READINGS = ("scan", "range", "lines", "landmarks")


def check(evidence: Evidence) -> Finding | None:
    """Readings pause for more than two seconds and ten times their usual distance: where the robot was is not seen."""
    for role in _READINGS:
        topic = evidence.topics.get(role)
        if topic is None:
            continue
        stamps = np.sort(topic.stamp_ns[topic.stamp_ns >= 0])
        if stamps.size < 10:
            continue
        steps = np.diff(stamps) * 1e-9
        limit = max(_SHORTEST_S, _TIMES * float(np.median(steps)))
        long = np.flatnonzero(steps > limit)
        if long.size:
            worst = int(np.argmax(steps))
            return Finding(
                code="W106",
                severity="note",
                where=topic.where,
                seen=f"{long.size} gaps of more than {limit:.1f} s, the longest {steps[worst]:.1f} s after"
                f" {stamp_text(int(stamps[worst]))}",
                effect="there the odometry alone says where the robot went",
                way_out="--start and --end leave a part out",
            )
    return None
