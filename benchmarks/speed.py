"""Speed and memory, each beside something measured in the same run.

python benchmarks/speed.py
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import worlds

from pfcli.replay.log import Log

CLI = [sys.executable, "-c", "from pfcli.cli.app import run; run()"]


def timed(*words: str, env: dict[str, str] | None = None) -> tuple[float, float]:
    """Wall seconds and peak memory (MiB) of a command."""
    began = time.perf_counter()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=env)
    _, status, usage = os.wait4(process.pid, 0)
    assert status == 0, words
    return time.perf_counter() - began, usage.ru_maxrss / 1024


def median(*words: str, runs: int = 5) -> tuple[float, float]:
    """Median wall seconds and the largest peak memory."""
    rows = [timed(*words) for _ in range(runs)]
    return float(np.median([r[0] for r in rows])), max(r[1] for r in rows)


def replay_rate(log: Path) -> tuple[float, float]:
    """File messages per second: ours (scan and odometry decoded), and mcap's StreamReader with rosbags."""
    total = sum(batch.channel.size for batch in Log(log)._file.batches())
    ours = []
    for _ in range(4):
        began = time.perf_counter()
        for _ in Log(log).events(["odometry", "scan", "source_stamp"]):
            pass
        ours.append(total / (time.perf_counter() - began))
    from mcap.records import Message, Schema
    from mcap.stream_reader import StreamReader

    from pfcli.formats.schemas import typestore

    began = time.perf_counter()
    wanted: dict[int, str] = {}
    schemas: dict[int, str] = {}
    with open(log, "rb") as file:
        for record in StreamReader(file).records:
            if isinstance(record, Schema):
                schemas[record.id] = record.name
            elif isinstance(record, Message):
                typestore().deserialize_cdr(record.data, wanted[record.channel_id])
            elif hasattr(record, "topic"):
                wanted[record.id] = schemas[record.schema_id]
    return float(np.median(ours[1:])), total / (time.perf_counter() - began)


def main() -> None:
    """Print the table."""
    log = worlds.recorded("intel")
    print("| what | figure | beside it, same run |")
    print("|---|---|---|")
    helped, _ = median(*CLI, "--help")
    bare, _ = median(sys.executable, "-c", "import click")
    print(f"| pfcli --help | {helped:.3f} s | python importing click {bare:.3f} s |")
    ours, theirs = replay_rate(log)
    print(f"| replay of the Intel log | {ours:.0f} messages/s | StreamReader + rosbags {theirs:.0f} messages/s |")
    with tempfile.TemporaryDirectory() as folder:
        for n in (10, 30):
            words = [*CLI, "slam-gdr", str(log), "--out", f"{folder}/o", "--force", "--particles", str(n)]
            timed(*words)
            seconds, memory = median(*words, runs=3)
            loop = np.median([worlds.slam(log, 0, particles=n).seconds["loop"] for _ in range(3)])
            print(f"| Intel, {n} particles | whole {seconds:.2f} s, loop {loop:.2f} s, {memory:.0f} MiB | |")
        cold = {
            k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"
        }  # set by this process for its own kernels
        cold["PFCLI_CACHE_DIR"] = f"{folder}/cache"
        small = [*CLI, "slam-gdr", str(worlds.simulated("small-loop")), "--force", "--out"]
        first, _ = timed(*small, f"{folder}/a", env=cold)
        again, _ = timed(*small, f"{folder}/a", env=cold)
        print(f"| first run ever (cold compile) | {first:.1f} s | second run {again:.1f} s |")
    print(f"| this process | {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB | |")


if __name__ == "__main__":
    main()
