"""Progress of a replay on standard error: a bar on a terminal, JSON lines, or nothing."""

import json
import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

_T = TypeVar("_T")
MODES = ("auto", "never", "json")


def progress(items: Iterable[_T], mode: str, label: str) -> Iterator[_T]:
    """Pass items through and report, at most five times a second, how many there were."""
    terminal = mode == "auto" and sys.stderr.isatty()
    if not terminal and mode != "json":
        yield from items
        return
    began = last = time.monotonic()
    count = 0
    try:
        for item in items:
            yield item
            count += 1
            if count & 63 == 0 and (now := time.monotonic()) - last > 0.2:
                last = now
                _report(mode, label, count, now - began)
    finally:
        _report(mode, label, count, time.monotonic() - began)
        if terminal:
            sys.stderr.write("\n")


def _report(mode: str, label: str, count: int, seconds: float) -> None:
    if mode == "json":
        line = json.dumps({"progress": label, "scans": count, "seconds": round(seconds, 3)}) + "\n"
    else:
        line = f"\r{label}: {count} scans, {count / max(seconds, 1e-9):.0f}/s "
    sys.stderr.write(line)
    sys.stderr.flush()
