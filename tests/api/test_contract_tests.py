"""The contract tests find what breaks the contract: each check fails on a system that was made to break it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest

from pfcli import registry
from pfcli.api import contract_tests
from pfcli.api.contract_tests import Case
from pfcli.params import Opt
from pfcli.systems.shared.chart import one
from tests.contracts.examples import CASES

CASE = CASES["slam-gdr"]


@dataclass(frozen=True, kw_only=True)
class _Undocumented:
    particles: Annotated[int, Opt("", "", 1, 10)] = 5


@dataclass(frozen=True, kw_only=True)
class _Illegal:
    share: Annotated[float, Opt("a share", "", 0, 1)] = 5.0


def test_a_parameter_without_help_or_with_an_illegal_default(tmp_path: Path) -> None:
    for params, error in ((_Undocumented, AssertionError), (_Illegal, Exception)):
        with pytest.raises(error):
            contract_tests.parameters_are_declared_and_survive_toml(_case(params=params), tmp_path)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"summary": "no sentence"}, "another record"),
        ({"name": "slam-gdr --landmarks"}, "another record"),
    ],
)
def test_a_record_that_the_entry_point_does_not_give(changed: dict[str, Any], says: str, tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=says):
        contract_tests.record_and_filter_belong_together(_case(**changed), tmp_path)


def test_a_chart_of_a_column_that_no_row_has(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    case = _case(charts=(one("?", "no_such_column"),))
    monkeypatch.setattr(registry, "system", lambda _: case.system)
    with pytest.raises(AssertionError, match="no_such_column"):
        contract_tests.record_and_filter_belong_together(case, tmp_path)


def test_a_page_with_too_few_equations_or_names_of_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        contract_tests.the_paper_page_names_what_exists(_case(equations=999), tmp_path)
    monkeypatch.setattr(contract_tests, "_exists", lambda name: not name.endswith("disperse"))
    with pytest.raises(AssertionError, match=r"gdr\.disperse"):
        contract_tests.the_paper_page_names_what_exists(CASE, tmp_path)


def test_a_run_that_is_another_one_the_second_time(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Random numbers of its own, which no seed decides."""
    honest, noise = registry.filter_of(CASE.system), np.random.default_rng()

    def finish(*given: Any) -> Any:
        found = honest.finish(*given)
        return found._replace(track=found.track._replace(poses=found.track.poses + noise.random()))

    monkeypatch.setattr("pfcli.runs.loop.filter_of", lambda _: honest._replace(finish=finish))
    with pytest.raises(AssertionError):
        contract_tests.a_second_run_compiles_nothing(CASE, tmp_path)


def _written(case: Case, *words: str) -> None:
    """Stands for the command: files whose bytes are the words."""
    out = Path(next(word for word in words if word.startswith("--out=")).removeprefix("--out="))
    out.mkdir()
    for file in contract_tests.FILES:
        (out / file).write_text(" ".join(word for word in words if not word.startswith("--out=")))


def test_bytes_that_the_number_of_threads_decides(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(contract_tests, "_command", _written)
    with pytest.raises(AssertionError, match=r"frames\.parquet is another one with two threads"):
        contract_tests.same_bytes_with_1_and_2_threads_and_again(CASE, tmp_path)


def test_a_seed_that_changes_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(contract_tests, "_command", lambda case, out, seed: _written(case, out))
    with pytest.raises(AssertionError, match="seeds 1 and 2 give the same track"):
        contract_tests.another_seed_gives_another_track(CASE, tmp_path)


def _case(**changed: Any) -> Case:
    return CASE._replace(system=CASE.system._replace(**changed))
