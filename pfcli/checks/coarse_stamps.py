"""W102: stamps are coarser than the messages are apart."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_FEWEST = 20
_SHARE = 0.3


def check(evidence: Evidence) -> Finding | None:
    """Many messages of a topic share a stamp with the one before: stamps in whole seconds, or a clock that ticks slowly."""
    for role, topic in evidence.topics.items():
        stamps = topic.stamp_ns[topic.stamp_ns >= 0]
        if stamps.size < _FEWEST or (stamps == stamps[0]).all() or role in ("range", "landmarks", "lines", "truth"):
            continue
        steps = np.diff(stamps)
        same = float((steps == 0).mean())
        if same > _SHARE:
            tick_s = float(np.median(steps[steps > 0])) * 1e-9
            return Finding(
                code="W102",
                severity="doubt",
                where=topic.where,
                seen=f"{100 * same:.0f} % of the stamps repeat the one before; the others step by {tick_s:g} s",
                effect="readings get the pose of another moment",
                way_out="--time log takes the recorder's clock",
            )
    return None
