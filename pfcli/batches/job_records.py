"""What became of the jobs of a batch: folders of done ones, records of failed ones, and the progress."""

import json
import shutil
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from pfcli.batches.sweep import Task
from pfcli.errors import EXIT_PARTIAL
from pfcli.formats.atomic import output_file

_STALE_S = 300.0


class Tally:
    """Counts, and the files beside the jobs' folders. out: of the batch; mode: of the progress."""

    def __init__(self, out: Path, mode: str) -> None:
        self.out = out
        self.failed: dict[str, str] = {}
        self.done = self.partial = self.skipped = 0
        self._mode, self._total, self._began, self._last = mode, 0, time.monotonic(), 0.0

    def target(self, task: Task) -> Path:
        """The folder of a job."""
        return self.out / "jobs" / task.key

    def open(self, tasks: list[Task]) -> list[Task]:
        """The jobs that are not done yet. What a killed batch left half is swept away."""
        (self.out / "jobs").mkdir(parents=True, exist_ok=True)
        for part in (self.out / "jobs").glob(".*.*.*"):
            # other shards may be writing here; a folder is half for the moment that its files take
            with suppress(OSError):
                if time.time() - part.stat().st_mtime > _STALE_S:
                    shutil.rmtree(part, ignore_errors=True)
        codes = [self.code(task) for task in tasks]
        left = [task for task, code in zip(tasks, codes, strict=True) if code is None]
        self.skipped, self._total = len(tasks) - len(left), len(left)
        self.partial = codes.count(EXIT_PARTIAL)
        return left

    def code(self, task: Task) -> int | None:
        """The exit code of a job that is done; None where it is not, or where a full disk or a power cut left no record."""
        try:
            return int(json.loads((self.target(task) / "job.json").read_text())["exit"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def succeed(self, task: Task, code: int) -> None:
        """A job is done."""
        self.done += 1
        self.partial += code == EXIT_PARTIAL
        (self.out / "failed" / f"{task.key}.json").unlink(missing_ok=True)
        self._report()

    def fail(self, task: Task, why: str, log: str = "") -> None:
        """A job failed for good; log: what its worker said last."""
        self.failed[task.key] = why
        folder = self.out / "failed"
        folder.mkdir(exist_ok=True)
        record: dict[str, Any] = {**task.record(), "why": why} | ({"log": log} if log else {})
        with output_file(folder / f"{task.key}.json") as partial:
            partial.write_text(json.dumps(record, indent=2) + "\n")
        self._report()

    def close(self) -> None:
        """End the line of a terminal."""
        self._report(last=True)
        if self._mode == "auto" and sys.stderr.isatty():
            sys.stderr.write("\n")

    def _report(self, last: bool = False) -> None:
        terminal = self._mode == "auto" and sys.stderr.isatty()
        now = time.monotonic()
        if not (terminal or self._mode == "json") or (now - self._last < 0.2 and not last):
            return
        self._last = now
        ended, seconds = self.done + len(self.failed), now - self._began
        rate = ended / max(seconds, 1e-9)
        left_s = (self._total - ended) / rate if ended else float("nan")
        if self._mode == "json":
            line = {"jobs": ended, "of": self._total, "failed": len(self.failed), "seconds": round(seconds, 3)}
            sys.stderr.write(json.dumps(line) + "\n")
        else:
            failed = f", {len(self.failed)} failed" if self.failed else ""
            sys.stderr.write(f"\rbatch: {ended} of {self._total} jobs{failed}, {rate:.1f}/s, {left_s:.0f} s left ")
        sys.stderr.flush()
