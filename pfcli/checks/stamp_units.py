"""W103: stamps count something else than nanoseconds."""

import numpy as np

from pfcli.checks.evidence import Evidence, Topic
from pfcli.findings import Finding

_FEWEST = 20
_FACTOR = 20.0
_FASTEST_HZ, _SLOWEST_S = 5000.0, 600.0


def check(evidence: Evidence) -> Finding | None:
    """The stamps of a topic run much faster or slower than the recorder's clock, or tell rates that no sensor has."""
    for role, topic in evidence.topics.items():
        stamps = topic.stamp_ns[topic.stamp_ns >= 0]
        if stamps.size < _FEWEST or np.ptp(stamps) == 0 or role in ("range", "landmarks"):
            continue
        ratio = _ratio(topic)
        step_s = float(np.ptp(stamps)) * 1e-9 / (stamps.size - 1)
        if ratio is not None and not 1 / _FACTOR < ratio < _FACTOR:
            seen = f"one second of the recorder is {ratio:.3g} s of its stamps"
        elif ratio is None and step_s < 1 / _FASTEST_HZ:
            seen = f"its stamps tell {1 / step_s:.0f} messages a second"
        elif ratio is None and step_s > _SLOWEST_S:
            seen = f"its stamps lie {step_s:.0f} s apart on the average"
        else:
            continue
        return Finding(
            code="W103",
            severity="doubt",
            where=topic.where,
            seen=seen,
            effect="speeds, gaps and ages of readings are wrong by that factor",
            way_out="stamps are nanoseconds (ROS: sec and nanosec); write them so, or --time log",
        )
    return None


def _ratio(topic: Topic) -> float | None:
    """Seconds by stamps in a second of the recorder; None where the recorder has no clock of its own."""
    step, log = np.diff(topic.stamp_ns), np.diff(topic.log_ns)
    good = (topic.stamp_ns[1:] >= 0) & (topic.stamp_ns[:-1] >= 0)
    if (step[good] == log[good]).mean() > 0.9 or log[good].sum() <= 0:
        return None
    return abs(float(step[good].sum())) / float(log[good].sum())
