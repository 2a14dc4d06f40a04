"""Numba with a cache that is never stale: its folder is keyed by the package's sources.

Import numba through this module only: `NUMBA_CACHE_DIR` must be set before numba is imported.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

_Function = Callable[..., Any]


def cache_root() -> Path:
    """Folder for everything pfcli keeps between runs: `PFCLI_CACHE_DIR`, else the user's cache folder."""
    configured = os.environ.get("PFCLI_CACHE_DIR")
    if configured:
        return Path(configured)
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(home) / "pfcli"


def _kernel_dir() -> Path:
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        digest.update(source.read_bytes())
    folder = cache_root() / f"kernels-{digest.hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="pfcli-kernels-"))


os.environ.setdefault("NUMBA_CACHE_DIR", str(_kernel_dir()))
# idle OpenMP threads spin for milliseconds by default: two runs on two cores then take five times as long as one
os.environ.setdefault("GOMP_SPINCOUNT", "3000")

import numba  # noqa: E402  (the cache folder has to be known first)

prange = numba.prange


def kernel(function: _Function) -> Any:
    """Compile a serial kernel: IEEE arithmetic, no exceptions on division, cached on disk."""
    return numba.njit(cache=True, error_model="numpy")(function)


def parallel_kernel(function: _Function) -> Any:
    """Compile a kernel whose iterations write only their own rows, so that threads cannot change a byte."""
    return numba.njit(cache=True, error_model="numpy", parallel=True)(function)


def reduction_kernel(function: _Function) -> Any:
    """Compile sums that LLVM may reorder into vector lanes: the order is fixed when compiling, not by the threads."""
    fast = {"reassoc", "contract", "nsz", "arcp"}
    return numba.njit(cache=True, error_model="numpy", fastmath=fast)(function)


def inline_kernel(function: _Function) -> Any:
    """Compile a helper of other kernels that LLVM should always inline (a call per beam would dominate)."""
    return numba.njit(cache=True, error_model="numpy", forceinline=True)(function)


def set_threads(count: int) -> None:
    """Use `count` threads in parallel kernels (at most what numba started with)."""
    numba.set_num_threads(max(1, min(count, numba.config.NUMBA_NUM_THREADS)))
