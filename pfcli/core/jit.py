"""Numba as kernels use it. Import numba through this module only: it says where compiled kernels are kept."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

from pfcli.core.kernel_cache import cache_root

__all__ = ["SOURCES", "cache_root", "inline_kernel", "kernel", "put", "reduction_kernel"]

_Function = Callable[..., Any]


def _sources_digest() -> str:
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


SOURCES = _sources_digest()
"""Digest of the package's sources: whatever is kept between runs under a name with it is never stale."""

numba.config.CACHE_LOCATOR_CLASSES = (
    "pfcli.core.kernel_cache.ModuleLocator,"
    "UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator,IPythonCacheLocator,ZipCacheLocator"
)


def kernel(function: _Function) -> Any:
    """Compile a serial kernel: IEEE arithmetic, no exceptions on division, no GIL, cached on disk.

    Where its first arguments are a range of rows `low, high`, `pfcli.core.threads.spread` runs it on all cores.
    """
    return numba.njit(cache=True, error_model="numpy", nogil=True)(function)


def reduction_kernel(function: _Function) -> Any:
    """Compile sums that LLVM may reorder into vector lanes: the order is fixed when compiling, not by the threads.

    Always inlined: a second copy of the same function, compiled for itself, may add up in another order, and which of the
    two is called depends on what else the process has compiled.
    """
    fast = {"reassoc", "contract", "nsz", "arcp"}
    return numba.njit(cache=True, error_model="numpy", nogil=True, fastmath=fast, forceinline=True)(function)


def inline_kernel(function: _Function) -> Any:
    """Compile a helper of other kernels that LLVM should always inline (a call per beam would dominate)."""
    return numba.njit(cache=True, error_model="numpy", forceinline=True)(function)


@inline_kernel
def put(target, source):
    """target[:] = source, for kernels, which must see to it that both have the same size. Numba's own assignment of one array
    (or row) to another compiles the text of an error as well, which takes three seconds."""
    for k in range(target.size):
        target.flat[k] = source.flat[k]
