"""Kernels compiled before a run needs them, in two or more processes at once, and said so.

Compiling takes longer than many runs. Each system has a list of the kernels that its runs call (`kernels.json` beside its
record, written by `make kernels`). What the list lacks is compiled when it is called, as ever.
"""

import contextlib
import fcntl
import importlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import IO, Any, NamedTuple

from pfcli.core import kernel_cache, signatures
from pfcli.core.threads import cores
from pfcli.systems.shared.contract import System


class Kernel(NamedTuple):
    """A kernel and the types that it is called with; cost_s: how long it took to compile where the list was made."""

    module: str
    name: str
    types: Any
    cost_s: float


def kernels_of(system: System) -> list[Kernel]:
    """The list of a system, the longest first; empty where it has none."""
    module = importlib.import_module(system.filter.split(":")[0])
    path = Path(str(module.__file__)).with_name("kernels.json")
    if not path.is_file():
        return []
    rows = [Kernel(*row) for row in json.loads(path.read_text())]
    return sorted(rows, key=lambda row: (-row.cost_s, row.module, row.name))


def compile_one(kernel: Kernel) -> None:
    """Compile a kernel, or find it in the cache."""
    dispatcher = getattr(importlib.import_module(kernel.module), kernel.name)
    dispatcher.compile(tuple(signatures.from_json(t) for t in kernel.types))


def ensure(system: System, say: Callable[[str], None], workers: int = 0) -> int:
    """Compile the kernels of a system that are not in the cache; how many were not. say: hears of the progress.

    Another process that does the same is waited for: kernels are compiled once."""
    mark = _mark(system)
    if mark is None or mark.exists():
        return 0
    with _lock(mark.parent, say) as mine:
        if not mine or mark.exists():
            return 0
        kernels = kernels_of(system)
        if _compiled(kernels, workers or cores(), say) == len(kernels):
            mark.touch()
    return len(kernels)


def _mark(system: System) -> Path | None:
    """An empty file that stands in the cache where all kernels of a system are; None where it has no list, or no cache."""
    kernels = kernels_of(system)
    for module in sorted({kernel.module for kernel in kernels}):
        importlib.import_module(module)
    if not kernels or not kernel_cache.kernel_dir().is_relative_to(kernel_cache.cache_root()):
        return None
    text = ",".join(kernel_cache.digest(module) for module in sorted({kernel.module for kernel in kernels}))
    return kernel_cache.kernel_dir() / f"warm-{system.key}-{kernel_cache.digest_of(text)}"


@contextlib.contextmanager
def _lock(folder: Path, say: Callable[[str], None]) -> Iterator[bool]:
    """Held while compiling; False where the folder cannot be locked."""
    try:
        file = open(folder / "lock", "w")
    except OSError:
        yield False
        return
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            say("waiting for another pfcli that compiles kernels")
            fcntl.flock(file, fcntl.LOCK_EX)
        yield True


def _compiled(kernels: list[Kernel], workers: int, say: Callable[[str], None]) -> int:
    """Hand the kernels to worker processes, one after the other; how many came back compiled."""
    queue: SimpleQueue[tuple[int, Kernel]] = SimpleQueue()
    for numbered in enumerate(kernels, 1):
        queue.put(numbered)

    def work(_: int) -> int:
        done = 0
        with _worker() as (ask, answers), contextlib.suppress(Empty, OSError):
            while answers.readline():
                number, kernel = queue.get_nowait()
                say(f"compiling kernels, once: {number} of {len(kernels)}")
                ask.write(json.dumps(kernel) + "\n")
                ask.flush()
                done += 1
        return done

    with ThreadPoolExecutor(workers) as pool:
        return sum(pool.map(work, range(min(workers, len(kernels)))))


@contextlib.contextmanager
def _worker() -> Iterator[tuple[IO[str], IO[str]]]:
    """A process that compiles what it is given: where to ask, and where its answers come from."""
    env = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-m", "pfcli.runs.warm"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=env) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            yield process.stdin, process.stdout
            process.stdin.close()
        except BaseException:
            process.kill()
            raise


def _serve() -> None:
    """A worker: kernels in, a line out when it wants the next."""
    print("ready", flush=True)
    for line in sys.stdin:
        # what cannot be compiled beforehand is compiled when it is called, and says why there
        with contextlib.suppress(Exception):
            compile_one(Kernel(*json.loads(line)))
        print("next", flush=True)


if __name__ == "__main__":
    _serve()
