"""The example runs that the records of the systems name, on the sample logs."""

from pathlib import Path
from typing import Any

from pfcli import registry
from pfcli.cli.system_command import parsed
from pfcli.params import build
from pfcli.runs.loop import Job
from pfcli.systems.shared.contract import Example, System

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
RECORDS = dict(registry.records())


def example_of(system: System) -> Example:
    """Its example; every system has one."""
    assert system.example is not None, f"{system.name}: its record names no example"
    return system.example


def log_of(system: System) -> Path:
    """Its sample log."""
    return SAMPLES / example_of(system).log


def map_of(system: System) -> Path | None:
    """Its map."""
    return SAMPLES / example_of(system).map if system.map else None


def words_of(system: System) -> list[str]:
    """The words of its command: log and options; files of the sample folder by their whole path."""
    example = example_of(system)
    given = [str(SAMPLES / word) if (SAMPLES / word).is_file() else word for word in example.options]
    flag = [f"--map={SAMPLES / example.map}"] if system.map else []
    return [*system.name.split(), str(log_of(system)), *given, *flag]


def job_of(system: System, params: dict[str, Any], **more: Any) -> Job:
    """The example as a job with defaults but for these parameters; more: other fields of the job."""
    command, *words = words_of(system)
    job: Job = parsed(command, [*words, "--out", "unused"])
    return job._replace(params=build(system.params, params, "test"), **more)
