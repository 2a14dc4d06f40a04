"""W105: stamps run backwards: two runs in one log, or a clock that was set."""

import numpy as np

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

_BACK_NS = 500_000_000
_MENDED_S = 2.0
"""What the reorder buffer puts right by itself."""


def check(evidence: Evidence) -> Finding | None:
    """The stamps of one topic go back by more than half a second somewhere in the file."""
    for topic in evidence.topics.values():
        stamps = topic.stamp_ns[topic.stamp_ns >= 0]
        if stamps.size < 2:
            continue
        newest = np.maximum.accumulate(stamps)
        starts = np.flatnonzero(np.diff(stamps) < -_BACK_NS)
        if starts.size:
            back_s = float((newest - stamps).max()) * 1e-9
            return Finding(
                code="W105",
                severity="doubt" if back_s > _MENDED_S or starts.size > 0.01 * stamps.size else "note",
                where=topic.where,
                seen=f"time goes back {starts.size} times, by up to {back_s:.3f} s",
                effect="messages of different moments are mixed, or left out as late",
                way_out="--start/--end take one run; --time log if a clock was set; --reorder if messages were only late",
            )
    return None
