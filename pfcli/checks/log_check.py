"""What is wrong with a log: its messages are decoded, as a run would, and looked at by every check."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from pfcli.checks.evidence import Evidence
from pfcli.checks.table import judged
from pfcli.dropped import Dropped
from pfcli.errors import PfcliError, printable
from pfcli.findings import Finding, without
from pfcli.replay.log import Log
from pfcli.replay.settings import Settings

_ROLES = ("odometry", "encoders", "twist", "imu", "compass", "scan", "range", "lines", "landmarks")
_PAIRS, _DEEP_PAIRS = 256, 1 << 20


class Checked(NamedTuple):
    """What was found, how many messages of each role were looked at, and the topic of each role."""

    findings: list[Finding]
    read: dict[str, int]
    topics: dict[str, str]


def check_log(paths: Sequence[Path], settings: Settings, *, deep: bool = False, ignore: Sequence[str] = ()) -> Checked:
    """Decode and judge a log; deep: match every pair of scans, not a sample. Raises LogError where it cannot be opened."""
    log = Log(list(paths), settings)
    topics, notes = _chosen(log)
    log.settings = settings._replace(topics={**settings.topics, **topics})
    roles, dropped = list(topics), Dropped()
    evidence = Evidence(log.path)
    refused: list[Finding] = []
    while roles:
        evidence = Evidence(log.path, _DEEP_PAIRS if deep else _PAIRS)
        try:
            for event in log.events(roles, evidence.stamps):
                evidence.event(event)
            dropped = log.dropped
            break
        except PfcliError as error:
            refused.append(_refusal(str(error)))
            roles = _without(roles, str(error), topics)
    findings = [*notes, *refused, *dropped.findings(), *judged(evidence)]
    return Checked(without(findings, ignore), dict(dropped.read), topics)


def _chosen(log: Log) -> tuple[dict[str, str], list[Finding]]:
    """The topic of every role that the log can fill; where several can, the first, and a note."""
    chosen, notes = {}, []
    for role, topics in log.roles().items():
        if role not in _ROLES or not topics:
            continue
        chosen[role] = topics[0] if role not in ("range", "landmarks") else ",".join(topics)
        if len(topics) > 1 and role not in ("range", "landmarks"):
            others = ", ".join(printable(topic) for topic in topics[1:])
            notes.append(
                Finding(
                    code="W614",
                    severity="note",
                    where=f"{log.path}: topic {printable(topics[0])!r}",
                    seen=f"is looked at as the {role}; {others} could be it too",
                    effect="a run asks which one is meant",
                    way_out=f"--topic {role}=TOPIC",
                )
            )
    return chosen, notes


def _refusal(text: str) -> Finding:
    return Finding(code="W615", severity="doubt", where="", seen=text, effect="a run ends with this line", way_out="")


def _without(roles: list[str], error: str, topics: dict[str, str]) -> list[str]:
    """The roles without the one that the message names by its topic; none where it names none."""
    bad = [role for role in roles if any(repr(printable(topic)) in error for topic in topics[role].split(","))]
    return [role for role in roles if role not in bad] if bad else []
