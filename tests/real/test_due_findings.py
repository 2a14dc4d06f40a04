"""`pfcli check` of recorded logs: the findings that are due, and no other."""

import tomllib
from pathlib import Path

import pytest

from pfcli.checks.log_check import check_log
from pfcli.replay.settings import Settings
from tests.conftest import needs

_DUE: dict[str, dict[str, str]] = tomllib.loads(Path(__file__).with_name("due_findings.toml").read_text())


@pytest.mark.real
@pytest.mark.parametrize("name", _DUE)
def test_recorded_logs_have_the_findings_that_are_due(name: str) -> None:
    findings = check_log([needs(name) / name], Settings()).findings
    assert {found.code for found in findings} == set(_DUE[name]), [found.line for found in findings]
