"""Kernels compiled before a run: their lists, the workers, and that it happens once."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pfcli.core import signatures
from pfcli.runs.warm import kernels_of
from pfcli.systems.shared.contract import System
from tests.contracts.examples import RECORDS

ONE = """
import sys
from pfcli import registry
from pfcli.runs import warm
(kernel,) = [k for k in warm.kernels_of(registry.system("slam-gdr")) if k.name == "compose"][:1]
warm.kernels_of = lambda system: [kernel]
heard = []
print(warm.ensure(registry.system("slam-gdr"), heard.append, 2), heard)
"""


@pytest.mark.parametrize("system", RECORDS.values(), ids=RECORDS)
def test_types_of_the_listed_kernels_survive_json(system: System) -> None:
    kernels = kernels_of(system)
    assert len(kernels) > 10
    assert [k.cost_s for k in kernels] == sorted((k.cost_s for k in kernels), reverse=True)
    for kernel in kernels:
        for data in kernel.types:
            assert json.loads(json.dumps(signatures.to_json(signatures.from_json(data)))) == data


def test_kernels_are_compiled_once_whoever_asks_first(tmp_path: Path) -> None:
    env = os.environ | {"PFCLI_CACHE_DIR": str(tmp_path)}
    both = [subprocess.Popen([sys.executable, "-c", ONE], env=env, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    said = sorted(process.communicate()[0].strip() for process in both)
    assert [process.returncode for process in both] == [0, 0]
    waited = {"0 []", "0 ['waiting for another pfcli that compiles kernels']"}
    assert said[0] in waited
    assert said[1] == "1 ['compiling kernels, once: 1 of 1']"
    again = subprocess.run([sys.executable, "-c", ONE], env=env, capture_output=True, text=True, check=True)
    assert again.stdout == "0 []\n"


@pytest.mark.slow
@pytest.mark.parametrize("system", RECORDS.values(), ids=RECORDS)
def test_the_lists_are_current(system: System, tmp_path: Path) -> None:
    """`make kernels` gives the same kernels with the same types."""
    script = Path(__file__).resolve().parents[2] / "sample_logs" / "kernels.py"
    env = os.environ | {"PFCLI_CACHE_DIR": str(tmp_path / "cache")}
    subprocess.run([sys.executable, script, system.key, tmp_path / "found.json"], check=True, env=env)
    found = {json.dumps(row[:3]) for row in json.loads((tmp_path / "found.json").read_text())}
    assert found == {json.dumps([k.module, k.name, k.types]) for k in kernels_of(system)}
