"""Findings: what was lost and noticed on the way, as lines with a code."""

from pfcli.dropped import Dropped
from pfcli.findings import CODES, Finding, known, without


def _finding(code: str = "W103", severity: str = "doubt", where: str = "a.mcap") -> Finding:
    return Finding(code=code, severity=severity, where=where, seen="seen", effect="effect", way_out="--flag")  # type: ignore[arg-type]


def test_a_finding_is_one_line_with_the_way_out() -> None:
    assert _finding().line == "W103 a.mcap: seen (effect; --flag)"
    assert _finding()._replace(where="", effect="", way_out="").line == "W103 seen"


def test_what_was_dropped_becomes_one_finding_for_each_reason_with_its_count() -> None:
    dropped = Dropped()
    for k in range(3):
        dropped.add("late", f"topic a: time goes back by {k} s")
    dropped.add("something new", "a note")
    found = dropped.findings()
    assert [(f.code, f.severity) for f in found] == [("W604", "loss"), ("W600", "loss")]
    assert found[0].seen == "3 x late: topic a: time goes back by 0 s"


def test_a_note_without_a_count_leaves_the_exit_code_alone() -> None:
    dropped = Dropped()
    dropped.notes.append("parts overlap")
    (found,) = dropped.findings()
    assert found.severity == "note"
    assert not found.shakes


def test_taking_another_replay_keeps_reasons_and_findings_once() -> None:
    one, other = Dropped(), Dropped()
    for dropped in (one, other):
        dropped.add("late", "a note")
        dropped.find(_finding())
        dropped.find(_finding())
    one.take(other)
    found = one.findings()
    assert [f.code for f in found] == ["W103", "W604"]
    assert found[1].seen.startswith("2 x late")


def test_silenced_codes_are_gone_and_doubt_comes_first() -> None:
    findings = [
        _finding("W106", "note"),
        _finding("W604", "loss"),
        _finding("W201", "doubt"),
        _finding("W201", "doubt"),
    ]
    assert [f.code for f in without(findings, ())] == ["W201", "W604", "W106"]
    assert [f.code for f in without(findings, ("W201",))] == ["W604", "W106"]


def test_codes_of_the_table_and_those_of_systems_are_known() -> None:
    assert known("W101")
    assert known("slam-gdr:W1")
    assert not known("W999")
    assert not known("slam-gdr:doubled")
    assert all(len(code) == 4 and title for code, title in CODES.items())
