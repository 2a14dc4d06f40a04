"""Whether a result can be believed, by rules over what needs no truth: good, doubtful or wrong."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pfcli.findings import Finding
from pfcli.runs.agreement import Agreement

_GRAVE = frozenset(
    {"W101", "W103", "W105", "W201", "W203", "W204", "W205", "W209", "W301", "W304", "W305", "W307", "W402"}
)
"""Findings about the input that leave hardly a result right."""


class Rules(NamedTuple):
    """Bounds of the measures: beyond the first of each pair a result is in doubt, beyond the second it is wrong.

    Doubled walls have none: cluttered rooms that are mapped right have as many (Intel 0.44) as halls that are mapped twice.
    """

    fit: tuple[float, float] = (0.65, 0.45)
    fit_worst: tuple[float, float] = (0.5, 0.15)
    with_pose: tuple[float, float] = (0.9, 0.3)
    settled: tuple[float, float] = (0.4, 0.3)
    way: tuple[float, float] = (1.5, 2.5)


RULES = Rules()


class Verdict(NamedTuple):
    """grade: good, doubtful or wrong; why: the measures that say so, in words; agreement: all measures."""

    grade: str
    why: tuple[str, ...]
    agreement: Agreement

    def row(self) -> dict[str, object]:
        """As it stands in `run.json`; a measure that does not apply is null."""
        numbers = {
            k: (round(v, 4) if np.isfinite(v) else None) if isinstance(v, float) else v
            for k, v in self.agreement._asdict().items()
        }
        return {"grade": self.grade, "why": list(self.why), **numbers}


def judge(measured: Agreement, findings: Sequence[Finding], rules: Rules = RULES) -> Verdict:
    """The verdict of a run by its measures and by what was found about its input."""
    m = measured
    way = max(m.way_ratio, 1 / max(m.way_ratio, 1e-9)) if np.isfinite(m.way_ratio) else 1.0
    bad: list[tuple[int, str]] = [
        _below(m.fit, rules.fit, f"{100 * m.fit:.0f} % of what was seen lies on the map"),
        _below(m.fit_worst, rules.fit_worst, f"{100 * m.fit_worst:.0f} % in the worst minute"),
        _below(m.with_pose, rules.with_pose, f"{100 * m.with_pose:.0f} % of the readings have a pose"),
        _below(m.settled, rules.settled, f"{m.jumps} jumps against the motion"),
        _below(-way, (-rules.way[0], -rules.way[1]), f"its way is {m.way_ratio:.2f} times that of the motion"),
    ]
    codes = [found.code for found in findings if found.severity == "doubt"]
    bad += [(2 if code in _GRAVE else 1, code) for code in dict.fromkeys(codes)]
    grade = max((level for level, _ in bad), default=0)
    why = tuple(text for level, text in bad if level == grade and level > 0)
    return Verdict(("good", "doubtful", "wrong")[grade], why, measured)


def finding_of(verdict: Verdict) -> list[Finding]:
    """The verdict as a finding, where the measures themselves (not only other findings) speak against the result."""
    reasons = [text for text in verdict.why if not text.startswith("W")]
    if verdict.grade == "good" or not reasons:
        return []
    wrong = verdict.grade == "wrong"
    found = Finding(
        code="W701" if wrong else "W702",
        severity="doubt" if wrong else "note",
        where="",
        seen=("the result is wrong: " if wrong else "the result is doubtful: ") + ", ".join(reasons),
        effect="poses and map may be elsewhere",
        way_out="pfcli check LOG looks for the reason; other seeds and more particles tell chance",
    )
    return [found]


def _below(value: float, bounds: tuple[float, float], text: str) -> tuple[int, str]:
    """0: fine (or it does not apply), 1: in doubt, 2: wrong."""
    if not np.isfinite(value):
        return 0, text
    return (2 if value < bounds[1] else 1 if value < bounds[0] else 0), text
