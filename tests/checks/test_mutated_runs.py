"""The table of issue 31: of the runs that a mistake in their log makes more than twice as bad, nearly all end with a doubt."""

import math
from pathlib import Path

import pytest

from pfcli.cli.system_command import parsed
from pfcli.errors import PfcliError
from pfcli.runs import loop
from tests.checks import mutations
from tests.checks.mutations import Mutation, Setting
from tests.conftest import SAMPLES

_LEAST_M, _LEAST_DEG = 0.01, 0.3
"""Errors below these are no mistake's doing."""


def _ran(setting: Setting, mutation: Mutation | None, folder: Path) -> tuple[float, float, bool]:
    """ATE (m) and heading error (deg) of a run, infinite where it was refused, and whether it said that something is wrong."""
    log = folder / f"{setting.sample}-{mutation.name if mutation else 'clean'}.mcap"
    mutations.write(SAMPLES / f"{setting.sample}.mcap", log, *([mutation] if mutation else []))
    words = [*setting.words[1:], str(log), "--out", str(folder / "out"), "--truth", "auto", "--threads", "1"]
    try:
        done = loop.execute(parsed(setting.words[0], words))
    except PfcliError:
        return math.inf, math.inf, True
    assert done.errors is not None
    found = done.errors.summary()
    return found["ate_m"], found["heading_rmse_deg"], any(f.shakes for f in done.findings)


@pytest.mark.slow
def test_what_a_mistake_makes_worse_is_flagged(tmp_path: Path) -> None:
    worse, silent, false_alarms = 0, [], []
    for setting in mutations.settings(SAMPLES):
        ate, heading, said = _ran(setting, None, tmp_path)
        if said:
            false_alarms.append(setting.sample)
        for mutation in setting.mutations:
            found = _ran(setting, mutation, tmp_path)
            if found[0] > 2 * max(ate, _LEAST_M) or found[1] > 2 * max(heading, _LEAST_DEG):
                worse += 1
                if not found[2]:
                    silent.append(f"{setting.sample} {mutation.name}")
    assert not false_alarms
    assert worse >= 45
    assert len(silent) <= 0.05 * worse, silent
