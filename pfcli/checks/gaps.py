"""W106: a topic pauses."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.events import stamp_text
from pfcli.findings import Finding

_SHORTEST_S, _TIMES = 2.0, 10.0
_BLIND_S, _BLIND_M = 5.0, 1.0
"""So far the robot may go unseen before the map behind it is in doubt."""
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
            way_m = _way(evidence, int(stamps[worst]), int(stamps[worst + 1]))
            return Finding(
                code="W106",
                severity="doubt" if steps[worst] > _BLIND_S and way_m > _BLIND_M else "note",
                where=topic.where,
                seen=f"{long.size} gaps of more than {limit:.1f} s, the longest {steps[worst]:.1f} s after"
                f" {stamp_text(int(stamps[worst]))}, in which the robot went {way_m:.1f} m",
                effect="there the odometry alone says where the robot went",
                way_out="--start and --end leave a part out",
            )
    return None


def _way(evidence: Evidence, begin_ns: int, end_ns: int) -> float:
    """How far (m) the motion source went between two stamps."""
    if len(evidence.motion) < 2 or evidence.start_ns is None:
        return 0.0
    begin, end = evidence.pose_at(np.array([begin_ns - evidence.start_ns, end_ns - evidence.start_ns]) * 1e-9)
    return float(np.hypot(*(end - begin)[:2]))
