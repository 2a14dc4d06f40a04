"""What every system must keep (`pfcli.api.contract_tests`), and how systems are found."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pfcli.api import contract_tests
from pfcli.api.contract_tests import Case
from tests.contracts.examples import CASES, RECORDS, SAMPLES


@pytest.mark.parametrize("check", contract_tests.CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_contract(case: Case, check: Callable[[Case, Path], None], tmp_path: Path) -> None:
    check(case, tmp_path)


def test_smoothing_keeps_the_bytes_too(tmp_path: Path) -> None:
    case = Case(RECORDS["slam-gdr"], SAMPLES, ("--end=100", "--particles=2", "--smooth"))
    contract_tests.same_bytes_with_1_and_2_threads_and_again(case, tmp_path)


def test_reading_all_records_imports_no_kernel_and_no_table() -> None:
    code = (
        "import sys; from pfcli import registry; assert len(registry.records()) >= 6;"
        "bad = {'numba', 'scipy', 'pyarrow', 'matplotlib', 'rosbags'} & set(sys.modules); assert not bad, bad"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_checkout_that_is_not_installed_says_how(tmp_path: Path) -> None:
    """Without its entry points there is no system: one line with the way out."""
    code = (
        "import importlib.metadata as m; m.entry_points = lambda **_: m.EntryPoints(());"
        "from pfcli.cli.app import run; import sys; sys.argv = ['pfcli', 'slam-gdr', 'x.mcap', '--out', 'o']; run()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "pfcli: pfcli is not installed, so its systems cannot be found: pip install -e .\n"


_MORE = """
import importlib.metadata as m
more = [m.EntryPoint(*words, 'pfcli.systems') for words in (
    ('slam-gdr', 'other_package:SYSTEM'), ('broken', 'no_such_package:SYSTEM'), ('odd', 'pfcli.registry:SYSTEMS'))]
ours = m.entry_points()
m.entry_points = lambda **_: m.EntryPoints([*ours.select(group='pfcli.systems'), *ours.select(group='pfcli.resamplers'), *more])
import sys
from pfcli.cli.app import run
sys.argv = ['pfcli', *sys.argv[1:]]
run()
"""


def _with_broken_packages(*words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([sys.executable, "-c", _MORE, *words], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        (
            "broken",
            "pfcli: system 'broken' (no_such_package:SYSTEM) cannot be imported: No module named 'no_such_package'\n",
        ),
        ("odd", "pfcli: system 'odd': pfcli.registry:SYSTEMS is no System record of that name\n"),
        (
            "slam-gdr",
            "pfcli: system 'slam-gdr' is brought by two packages, as other_package:SYSTEM and"
            " pfcli.systems.slam_gdr:SYSTEM; uninstall one\n",
        ),
    ],
)
def test_a_package_that_is_broken_says_so_in_one_line(name: str, says: str) -> None:
    done = _with_broken_packages(name, "x.mcap", "--out", "o")
    assert (done.returncode, done.stderr) == (2, says)


def test_a_package_that_is_broken_breaks_no_other_system() -> None:
    assert _with_broken_packages("localize-lookup", "--help").returncode == 0
    done = _with_broken_packages("--help")
    assert done.returncode == 0
    assert "no_such_package" in done.stdout.split("Cannot be used")[1]
