"""The Python API: what `import pfcli` gives. Public is what `pfcli.__all__` names; docs/python.md has examples.

It stands above the command line, so that a call is the very run of a command: the same checks, the same bytes.
"""

from pfcli.api.calls import default_params, evaluate, list_resamplers, list_systems, open, run
from pfcli.api.finished_run import DoubtfulResult, FinishedRun

__all__ = [
    "DoubtfulResult",
    "FinishedRun",
    "default_params",
    "evaluate",
    "list_resamplers",
    "list_systems",
    "open",
    "run",
]
