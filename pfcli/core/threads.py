"""Rows of a kernel spread over threads: each thread runs the same serial, GIL-free kernel on its own range of rows.

A kernel writes only its own rows, so the number of threads cannot change a byte. OpenMP loops would do the same, but
each is compiled a second time, and their idle threads spin: two runs on two cores slow each other. To wake a thread
costs 0.05-0.2 ms: worth it for kernels that take a good deal longer, so that these say how many rows do.
"""

import os
from _thread import allocate_lock
from collections.abc import Callable
from threading import Thread
from typing import Any


class _Worker:
    """One daemon thread that waits for a job, runs it and says so; a lock wakes faster than a queue."""

    def __init__(self) -> None:
        self._go, self._done = allocate_lock(), allocate_lock()
        self._go.acquire()
        self._done.acquire()
        self._job: tuple[Any, ...] = ()
        self._error: BaseException | None = None
        Thread(target=self._serve, daemon=True).start()

    def start(self, *job: Any) -> None:
        self._job = job
        self._go.release()

    def wait(self) -> None:
        self._done.acquire()
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _serve(self) -> None:
        while True:
            self._go.acquire()
            function, *arguments = self._job
            try:
                function(*arguments)
            except BaseException as error:
                self._error = error
            self._job = ()
            self._done.release()


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_workers: list[_Worker] = []
_count = cores()


def set_threads(count: int) -> None:
    """Spread rows over `count` threads (0: as many as there are cores)."""
    global _count
    _count = count or cores()


def rows_of(look_ups: int) -> int:
    """Rows of so many look-ups in a likelihood field, or as much work, that are worth waking a thread for: some 0.1 ms."""
    return 60_000 // max(1, look_ups) + 1


def spread(rows_kernel: Callable[..., Any], n: int, *arguments: Any, least: int = 1) -> None:
    """Run `rows_kernel(low, high, *arguments)` for rows 0 .. n; the calling thread takes the first share.

    least: rows that are worth waking a thread for."""
    parts = min(_count, n // least)
    if parts <= 1:
        rows_kernel(0, n, *arguments)
        return
    while len(_workers) < parts - 1:
        _workers.append(_Worker())
    cuts = [n * k // parts for k in range(parts + 1)]
    busy = _workers[: parts - 1]
    for k, worker in enumerate(busy, 1):
        worker.start(rows_kernel, cuts[k], cuts[k + 1], *arguments)
    try:
        rows_kernel(cuts[0], cuts[1], *arguments)
    finally:
        for worker in busy:
            worker.wait()
