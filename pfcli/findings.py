"""What was noticed about a log, a map or a result: findings with a code, and the table of the codes.

Whoever notices something raises it: replay, formats and systems through `Dropped.find`, checks by what they return.
"""

import re
from collections.abc import Collection, Iterable, Mapping
from typing import Any, Literal, NamedTuple

Severity = Literal["note", "loss", "doubt"]
"""note: worth a look, the result stands; loss: part of the input was not used; doubt: the result may be wrong."""


class Finding(NamedTuple):
    """One thing that was noticed.

    code: its row in `CODES`, or `SYSTEM:CODE` of a system's own (`System.codes`); where: file, topic, field; seen: what, with
    numbers; effect: what it does to the result; way_out: what to do about it, with the exact flag.
    """

    code: str
    severity: Severity
    where: str
    seen: str
    effect: str
    way_out: str

    @property
    def line(self) -> str:
        """One line to read."""
        rest = "; ".join(part for part in (self.effect, self.way_out) if part)
        place = f"{self.where}: " if self.where else ""
        return f"{self.code} {place}{self.seen}" + (f" ({rest})" if rest else "")

    @property
    def shakes(self) -> bool:
        """Whether a run with this finding ends with exit code 3."""
        return self.severity != "note"


CODES: Mapping[str, str] = {
    "W101": "stamps stand still",
    "W102": "stamps are coarse",
    "W103": "stamps are in another unit",
    "W104": "topics are stamped by different clocks",
    "W105": "stamps run backwards",
    "W106": "gaps in a topic",
    "W107": "scans and motion do not belong to the same moment",
    "W201": "odometry pose stands still while its twist moves",
    "W202": "quaternions that are no rotation",
    "W203": "odometry jumps",
    "W204": "turn of the odometry against that of the scans",
    "W205": "way of the odometry against that of the scans",
    "W206": "pose of the odometry against its twist",
    "W207": "wheels against odometry",
    "W208": "compass against the turn of the robot",
    "W209": "motion stands still while the scans move",
    "W210": "gyroscope against the turn of the robot",
    "W211": "readings of motion that are not numbers",
    "W301": "ranges in another unit",
    "W302": "single beams far beyond the others",
    "W303": "limits of the range finder that cannot be",
    "W304": "scans are mirrored",
    "W305": "laser is mounted otherwise than the log says",
    "W306": "a range within the limits that means no return",
    "W307": "scans that repeat",
    "W308": "few beams that measure anything",
    "W401": "field lines lie outside of the field",
    "W402": "points in another unit",
    "W403": "vision against the turn of the robot",
    "W501": "grey 205 of a map counts as free",
    "W502": "scans that fit nowhere in the map",
    "W503": "a map of one kind of cell",
    "W600": "part of the input was left out",
    "W601": "damaged places of a log",
    "W602": "messages that are missing",
    "W603": "messages that cannot be read",
    "W604": "messages that come too late",
    "W605": "stamps that are no time",
    "W606": "stamps that leap ahead",
    "W607": "readings without motion around them",
    "W608": "gaps in the odometry",
    "W609": "encoders that jump",
    "W610": "steering angles that cannot be",
    "W611": "scans without beams",
    "W612": "points that are not numbers",
    "W613": "landmarks that contradict themselves",
    "W614": "a note of the replay",
    "W615": "a log that cannot be replayed as it is",
    "W701": "the result contradicts the readings",
    "W702": "the result is doubtful",
}
"""Code -> title. 1xx stamps and clocks, 2xx motion, 3xx range finders, 4xx vision, 5xx maps, 6xx what was left out, 7xx
results."""

_LOSSES = {
    "damaged place": "W601",
    "missing message": "W602",
    "unreadable message": "W603",
    "late": "W604",
    "bad stamp": "W605",
    "leap of time": "W606",
    "scan before odometry": "W607",
    "sighting before odometry": "W607",
    "scan without odometry": "W607",
    "sighting without odometry": "W607",
    "gap in odometry": "W608",
    "jump of the encoders": "W609",
    "steering angle": "W610",
    "empty scan": "W611",
    "point that is not a number": "W612",
    "truth that is not a number": "W612",
    "depth aside": "W612",
    "landmark twice at a stamp": "W613",
    "landmark that moves": "W613",
    "landmarks seen once": "W613",
    "map doubtful": "W613",
    "quaternion": "W202",
    "reset of the odometry": "W203",
    "odometry without a pose": "W211",
}
"""What `Dropped` calls a loss -> its code; others are W600."""


def of_loss(why: str, count: int, notes: Iterable[str]) -> Finding:
    """What was left out for one reason, with the sentences that say where."""
    said = list(notes)
    way = said[0] + (f"; and {len(said) - 1} more places" if len(said) > 1 else "") if said else ""
    return Finding(
        code=_LOSSES.get(why, "W600"),
        severity="loss",
        where="",
        seen=f"{count} x {why}" + (f": {way}" if way else ""),
        effect="",
        way_out="",
    )


def without(findings: Iterable[Finding], ignored: Collection[str]) -> list[Finding]:
    """The findings that were not silenced, in order, the gravest first; one of a code and place."""
    rank = {"doubt": 0, "loss": 1, "note": 2}
    kept: dict[tuple[str, str, str], Finding] = {}
    for found in findings:
        if found.code not in ignored:
            key = (found.code, found.where, "" if found.where else found.seen)
            kept.setdefault(key, found)
    return sorted(kept.values(), key=lambda found: (rank[found.severity], found.code))


def known(code: str) -> bool:
    """Whether a word can be the code of a finding; those of systems are their own affair."""
    return code in CODES or re.fullmatch(r"[a-z][a-z0-9-]*:W\d+", code) is not None


def as_rows(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """Findings as they stand in `run.json`."""
    return [found._asdict() for found in findings]
