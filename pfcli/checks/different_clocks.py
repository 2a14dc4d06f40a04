"""W104: topics are stamped by different clocks."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_FEWEST = 10
_APART_S, _DOUBT_S = 0.08, 0.4
_MOTION = ("odometry", "encoders", "twist", "imu")


def check(evidence: Evidence) -> Finding | None:
    """What is read and what tells motion lie differently far behind the recorder's clock: by more than a latency."""
    behind = {}
    for role, topic in evidence.topics.items():
        good = topic.stamp_ns >= 0
        if good.sum() >= _FEWEST and role not in ("truth", "source_stamp"):
            behind[role] = float(np.median((topic.log_ns - topic.stamp_ns)[good])) * 1e-9
    motion = next((role for role in _MOTION if role in behind), None)
    others = [role for role in behind if role not in _MOTION]
    if motion is None or not others:
        return None
    role = max(others, key=lambda other: abs(behind[other] - behind[motion]))
    apart_s = behind[role] - behind[motion]
    if abs(apart_s) < _APART_S:
        return None
    return Finding(
        code="W104",
        severity="doubt" if abs(apart_s) > _DOUBT_S else "note",
        where=evidence.topics[role].where,
        seen=f"its stamps lie {behind[role]:.3f} s before the recorder's clock, those of the {motion} {behind[motion]:.3f} s",
        effect=f"readings may get the pose of {abs(apart_s):.3f} s {'later' if apart_s < 0 else 'earlier'}",
        way_out=f"--time-offset {role}={apart_s:.3f} if its clock is set otherwise; a latency of the sensor needs nothing",
    )
