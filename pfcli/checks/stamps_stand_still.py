"""W101: all stamps of a topic are the same."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.events import stamp_text
from pfcli.findings import Finding

_FEWEST = 5


def check(evidence: Evidence) -> Finding | None:
    """All stamps of a topic that is read are equal: drivers without a clock write zeros."""
    for topic in evidence.topics.values():
        usable = topic.stamp_ns[topic.stamp_ns >= 0]
        if usable.size >= _FEWEST and (usable == usable[0]).all():
            apart_s = float(np.ptp(topic.log_ns)) * 1e-9
            return Finding(
                code="W101",
                severity="doubt",
                where=topic.where,
                seen=f"all {usable.size} stamps are {stamp_text(int(usable[0]))}, recorded over {apart_s:.1f} s",
                effect="no motion and no time lies between the readings",
                way_out="--time log takes the recorder's clock",
            )
    return None
