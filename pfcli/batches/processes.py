"""Jobs in worker processes of this machine: each with one thread, a limit of time and of memory; one that dies takes only its
job with it."""

import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
import time
from collections import Counter, deque
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import NamedTuple

from pfcli.batches.job_records import Tally
from pfcli.batches.sweep import Task
from pfcli.batches.worker import CommandLine, fault, perform
from pfcli.errors import OutputError

_LOOK_S, _TRIES, _TAIL = 0.25, 2, 4000


class Limits(NamedTuple):
    """Of one job: wall-clock (s) and resident memory (MB); 0: none."""

    seconds: float = 0.0
    megabytes: float = 0.0


def _serve(line: Connection, log: str, cli: CommandLine) -> None:
    """A worker: jobs in, exit codes or reasons out."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    # what libraries print belongs to the job, and a crash of native code leaves its last words there
    target = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(target, 2)
    os.dup2(target, 1)
    import pfcli.runs.results  # noqa: F401

    threading.Thread(target=_end_with_parent, daemon=True).start()
    line.send((0, ""))
    while True:
        try:
            job = line.recv()
        except EOFError:
            return
        os.ftruncate(target, 0)
        os.lseek(target, 0, os.SEEK_SET)
        try:
            answer: tuple[int, str] = perform(cli, *job), ""
        except Exception as error:
            answer = 1, fault(error)
        try:
            line.send(answer)
        except BrokenPipeError:
            return


def _end_with_parent() -> None:
    """A batch that was killed leaves no worker behind."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


class _Worker:
    """A worker process, and the job that it has."""

    def __init__(self, log: Path, cli: CommandLine) -> None:
        self._log = log
        self.task: Task | None = None
        self.ready = False
        self.began = 0.0
        context = multiprocessing.get_context("spawn")
        self.line, far = context.Pipe()
        self.process = context.Process(target=_serve, args=(far, str(log), cli), daemon=True)
        self.process.start()
        far.close()

    def give(self, task: Task, target: Path) -> None:
        self.task, self.began = task, time.monotonic()
        self.line.send((task.system, task.words, task.record(), target))

    def over(self, limits: Limits) -> str:
        """Which limit the job is over, if any."""
        if limits.seconds and time.monotonic() - self.began > limits.seconds:
            return f"took longer than --timeout {limits.seconds:g} s"
        if limits.megabytes and _resident_mb(self.process.pid) > limits.megabytes:
            return f"needed more than --memory {limits.megabytes:g} MB"
        return ""

    def kill(self) -> str:
        """End the process; returns what it said last."""
        self.process.kill()
        self.process.join()
        self.line.close()
        try:
            return self._log.read_text(errors="replace")[-_TAIL:]
        except OSError:
            return ""


def _resident_mb(pid: int | None) -> float:
    """Resident memory of a process; 0 where the system does not tell."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def run_local(tasks: list[Task], tally: Tally, workers: int, limits: Limits, cli: CommandLine) -> None:
    """Run all jobs; what came of each is in the tally. Raises OutputError where no worker can begin."""
    queue, tries, in_vain = deque(tasks), Counter[str](), Counter[int]()
    logs = Path(tempfile.mkdtemp(prefix="pfcli-workers-"))
    pool: list[_Worker] = []

    def started(k: int) -> _Worker:
        return _Worker(logs / f"{k}.log", cli)

    def lost(k: int, why: str, *, again: bool) -> None:
        """A worker is no more; its job, if it was not the job's fault for certain, is tried once again. Raises OutputError
        where workers cannot even begin."""
        worker = pool[k]
        task, said = worker.task, worker.kill()
        in_vain.update([k] if not worker.ready else [])
        if in_vain[k] == _TRIES:
            last = next((line for line in reversed(said.splitlines()) if line.strip()), "it said nothing")
            raise OutputError(f"{tally.out}: a worker cannot begin: {why}: {last}")
        pool[k] = started(k)
        if task is None:
            return
        if again and tries[task.key] < _TRIES:
            queue.append(task)
        else:
            tally.fail(task, why, said)

    try:
        pool = [started(k) for k in range(min(workers, len(tasks)))]
        while queue or any(worker.task for worker in pool):
            for worker in pool:
                if worker.ready and worker.task is None and queue:
                    task = queue.popleft()
                    tries[task.key] += 1
                    with suppress(OSError):  # it died while it had nothing to do; that is seen below
                        worker.give(task, tally.target(task))
            wait([worker.line for worker in pool if worker.task is not None or not worker.ready], _LOOK_S)
            for k, worker in enumerate(pool):
                if worker.line.poll():
                    if not _heard(worker, tally):
                        lost(k, _died(worker), again=True)
                elif not worker.process.is_alive():
                    lost(k, _died(worker), again=True)
                elif worker.task is not None and (why := worker.over(limits)):
                    lost(k, why, again=False)
    finally:
        for worker in pool:
            worker.kill()
        shutil.rmtree(logs, ignore_errors=True)


def _died(worker: _Worker) -> str:
    worker.process.join(5)
    return f"its worker died (exit code {worker.process.exitcode})"


def _heard(worker: _Worker, tally: Tally) -> bool:
    """Take what a worker says; False where it is dead."""
    try:
        code, why = worker.line.recv()
    except (EOFError, OSError):
        return False
    task, worker.task = worker.task, None
    if task is None:
        worker.ready = True
    elif why:
        tally.fail(task, why)
    else:
        tally.succeed(task, code)
    return True
