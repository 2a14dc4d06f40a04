"""Time against scans and particles, memory against way: a picture beside this script.

python benchmarks/growth.py
"""

import time
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import worlds
from matplotlib import pyplot

from pfcli.params import build
from pfcli.registry import system
from pfcli.replay.settings import Settings
from pfcli.runs import loop


def loop_seconds(log: Path, particles: int, end_s: float | None = None) -> tuple[float, int]:
    """Loop time and number of scans."""
    slam = system("slam-gdr")
    done = loop.execute(
        loop.Job(slam, build(slam.params, {"particles": particles}, "b"), [log], settings=Settings(end_s=end_s))
    )
    return done.seconds["loop"], int(done.result.track.stamps_ns.size)


def main() -> None:
    """Print the numbers and draw growth.png."""
    log = worlds.recorded("intel")
    loop_seconds(log, 5, 100)
    ns = [2, 5, 10, 20, 40, 80]
    by_n = [loop_seconds(log, n, 700)[0] for n in ns]
    ends = [300, 700, 1400, 2100, 2700]
    by_scans = [loop_seconds(log, 10, e) for e in ends]
    office = worlds.slam(worlds.simulated("paper-60x50-long"), 0, True)
    figure, axes = pyplot.subplots(1, 3, figsize=(13, 4), layout="constrained")
    axes[0].plot(ns, by_n, "o-")
    axes[0].set(xlabel="particles", ylabel="loop [s], 700 s of Intel")
    axes[1].plot([s for _, s in by_scans], [t for t, _ in by_scans], "o-")
    axes[1].set(xlabel="scans", ylabel="loop [s], 10 particles, Intel")
    axes[2].plot([i.tiles for i in office.infos])
    axes[2].set(xlabel="update (four laps)", ylabel="tiles held, 10 particles")
    figure.savefig(Path(__file__).with_name("growth.png"), dpi=80)
    for n, t in zip(ns, by_n, strict=True):
        print(f"{n} particles: {t:.2f} s, {1e3 * t / n:.1f} ms a particle")
    for t, scans in by_scans:
        print(f"{scans} scans: {t:.2f} s, {1e6 * t / scans:.0f} us a scan")


if __name__ == "__main__":
    began = time.perf_counter()
    main()
