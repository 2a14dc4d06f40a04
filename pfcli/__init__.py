"""Replay recorded robot logs offline through published particle-filter systems."""

import importlib
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pfcli.api import DoubtfulResult as DoubtfulResult
    from pfcli.api import FinishedRun as FinishedRun
    from pfcli.api import default_params as default_params
    from pfcli.api import evaluate as evaluate
    from pfcli.api import list_resamplers as list_resamplers
    from pfcli.api import list_systems as list_systems
    from pfcli.api import open as open
    from pfcli.api import run as run

# The matrices of a filter are small: threads of a linear-algebra library wait for each other longer than they work (a smoothing
# run took 4 s with one and 86 s on a busy machine), and their number must not decide a byte. It counts before numpy is loaded.
for _library in ("OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

__version__ = "0.1.0"

__all__ = [
    "DoubtfulResult",
    "FinishedRun",
    "__version__",
    "default_params",
    "evaluate",
    "list_resamplers",
    "list_systems",
    "open",
    "run",
]
"""The Python API. No name of a module is among them: importing that would replace the function."""


def __getattr__(name: str) -> Any:
    """Public names are imported when they are asked for, so that `import pfcli` and the command's help stay fast."""
    if name in __all__:
        return getattr(importlib.import_module("pfcli.api"), name)
    raise AttributeError(f"module 'pfcli' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
