"""The example runs that the records of the systems name, on the sample logs."""

from pathlib import Path
from typing import Any

from pfcli import registry
from pfcli.api import contract_tests
from pfcli.api.contract_tests import Case
from pfcli.runs.loop import Job
from pfcli.systems.shared.contract import System

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
RECORDS = dict(registry.records())
CASES = {key: Case(system, SAMPLES) for key, system in RECORDS.items()}


def log_of(system: System) -> Path:
    """Its sample log."""
    return SAMPLES / contract_tests.example_of(Case(system, SAMPLES)).log


def map_of(system: System) -> Path | None:
    """Its map."""
    return SAMPLES / contract_tests.example_of(Case(system, SAMPLES)).map if system.map else None


def job_of(system: System, params: dict[str, Any], **more: Any) -> Job:
    """The example as a job with defaults but for these parameters; more: other fields of the job."""
    return contract_tests.job_of(Case(system, SAMPLES), params, **more)
