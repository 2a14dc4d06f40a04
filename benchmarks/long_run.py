"""Hours of driving through the same building: does memory stay, does the speed? `python benchmarks/long_run.py [HOURS]`.

The log is made on the fly. Memory is what the kernel says of the process every half second, speed is scans per second of
processor time; the first quarter, in which the map is completed, is left out, and so is the writing of results.
"""

import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from pfcli.formats import map_yaml
from pfcli.simulation.indoor_world import WORLDS, rasterize
from pfcli.simulation.scenario import Scenario, write

RUN = [sys.executable, "-c", "from pfcli.cli.app import run; run()"]


def make(path: Path, hours: float) -> dict[str, float]:
    """A log of so many hours on the route through the office, again and again."""
    world = WORLDS["office"](1)
    laps = int(hours * 3600 / 60) + 1
    WORLDS["office-for-hours"] = lambda seed: world._replace(route=np.tile(world.route, (laps, 1)))
    scenario = Scenario("long", "office-for-hours", rate_hz=4.0, odometry_hz=4.0, duration_s=hours * 3600)
    map_yaml.write(path.parent, rasterize(world, 0.05), "office")
    return write(scenario, 0, path)


def resident_mib(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return float("nan")


def processor_s(pid: int) -> float:
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def watch(words: list[str]) -> tuple[np.ndarray, int]:
    """(seconds of the processor, MiB, scans) rows while a command replays, and its exit code."""
    rows: list[tuple[float, float, int]] = []
    with tempfile.TemporaryFile("w+") as err:
        process = subprocess.Popen([*RUN, *words, "--progress", "json"], stderr=err, stdout=subprocess.DEVNULL)
        while process.poll() is None:
            time.sleep(0.5)
            err.seek(0)
            told = [line for line in err.read().splitlines() if line.startswith("{")]
            try:
                rows.append((processor_s(process.pid), resident_mib(process.pid), json.loads(told[-1])["scans"]))
            except (OSError, IndexError, ValueError):
                continue
    return np.array(rows), process.returncode


def judge(name: str, words: list[str]) -> None:
    rows, code = watch(words)
    last = rows[:, 2].max()
    replay = rows[(rows[:, 2] > 0.25 * last) & (rows[:, 2] < last)]
    cuts = np.searchsorted(replay[:, 2], np.linspace(replay[0, 2], replay[-1, 2], 7))
    rates = [
        (replay[b, 2] - replay[a, 2]) / (replay[b, 0] - replay[a, 0])
        for a, b in itertools.pairwise(np.minimum(cuts, len(replay) - 1))
    ]
    first, last_mib = replay[0, 1], replay[-1, 1]
    print(
        f"| {name} | exit {code}, {last:.0f} scans in {rows[-1, 0]:.0f} s of processor time"
        f" | memory {first:.0f} -> {last_mib:.0f} MiB ({last_mib / first - 1:+.1%})"
        f" | {', '.join(f'{r:.0f}' for r in rates)} scans/s (second half to first: {sum(rates[3:]) / sum(rates[:3]) - 1:+.1%}) |",
        flush=True,
    )


def main() -> None:
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 6.0
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "long.mcap"
        made = make(log, hours)
        size_mb, span_h = log.stat().st_size / 1e6, made["span_s"] / 3600
        print(f"{span_h:.2f} h, {made['way_m'] / 1000:.2f} km, {made['scans']} scans, {size_mb:.0f} MB")
        judge("slam-gdr", ["slam-gdr", str(log), "--out", f"{folder}/slam"])
        judge(
            "localize-reliable",
            ["localize-reliable", str(log), "--map", f"{folder}/office.yaml", "--out", f"{folder}/reliable"],
        )


if __name__ == "__main__":
    main()
