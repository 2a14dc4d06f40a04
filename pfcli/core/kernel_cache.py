"""Where compiled kernels are kept between runs: keyed by what a kernel depends on, so that the cache is never stale.

Numba looks at the file of a kernel only. What the kernel calls or reads from other modules is compiled into it, so the key
here is the text of its module and of all modules of its package, and of pfcli, that this one imports, directly or not. An edit
of another file, another checkout or a touched file compile nothing again.
"""

import hashlib
import os
import re
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba.core.caching import _CacheLocator

_JIT = "pfcli.core.jit"
_IMPORTS = re.compile(r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([\w.]+))", re.M)


def cache_root() -> Path:
    """Folder for everything pfcli keeps between runs: `PFCLI_CACHE_DIR`, else the user's cache folder."""
    configured = os.environ.get("PFCLI_CACHE_DIR")
    if configured:
        return Path(configured)
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(home) / "pfcli"


@cache
def kernel_dir() -> Path:
    """Folder of the compiled kernels; a temporary one, for this process, where the cache folder cannot be written."""
    folder = cache_root() / "kernels"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="pfcli-kernels-"))


@cache
def _text(module: str) -> str:
    return Path(str(sys.modules[module].__file__)).read_text()


@cache
def _imported(module: str, root: str) -> frozenset[str]:
    """The modules of pfcli and of the package `root` that a loaded module imports."""
    found = set()
    for parent, names, plain in _IMPORTS.findall(_text(module)):
        base = parent or plain
        if base.split(".")[0] not in ("pfcli", root):
            continue
        below = {f"{base}.{name}" for name in re.findall(r"\w+", names)}
        found |= {name for name in {base, *below} if getattr(sys.modules.get(name), "__file__", None)}
    return frozenset(found)


@cache
def digest(module: str) -> str:
    """SHA-256 (16 hex digits) of the text of a loaded module and of all that it imports of its package and of pfcli."""
    root, found, left = module.split(".")[0], set[str](), [module]
    while left:
        name = left.pop()
        if name not in found:
            found.add(name)
            left += _imported(name, root)
    return digest_of("".join(f"{name}\0{_text(name)}\0" for name in sorted(found)))


def digest_of(text: str) -> str:
    """SHA-256 of a text, 16 hex digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class ModuleLocator(_CacheLocator):  # type: ignore[misc]
    """The cache of the kernels of one module, by its name and digest."""

    def __init__(self, module: str, line: int) -> None:
        self._folder, self._line = f"{module}-{digest(module)}", line

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "ModuleLocator | None":
        """None for functions that are not of a module that uses `pfcli.core.jit`: they are numba's own affair."""
        module = py_func.__module__
        if not getattr(sys.modules.get(module), "__file__", None) or module == "__main__":
            return None
        if module != _JIT and _JIT not in _imported(module, module.split(".")[0]):
            return None
        return cls(module, py_func.__code__.co_firstlineno)

    def get_cache_path(self) -> str:
        """The folder."""
        return str(kernel_dir() / self._folder)

    def get_source_stamp(self) -> str:
        """The digest, which says it all."""
        return self._folder

    def get_disambiguator(self) -> str:
        """Functions of one name are told apart by their lines."""
        return str(self._line)
