"""slam-gdr on the recorded logs: relations of Intel and ACES, agreement on CSAIL, N = 10, 5 seeds, filter and --smooth.

python benchmarks/slam_real.py [particles] [seeds]
"""

import sys

import numpy as np
import worlds


def main(particles: int = 10, seeds: int = 5) -> None:
    """Print a row per log and seed, then the means."""
    for smooth in (False, True):
        print(f"\n{'--smooth' if smooth else 'the filter'}\n")
        _table(particles, seeds, smooth)


def _table(particles: int, seeds: int, smooth: bool) -> None:
    print(
        "| log | seed | >= 100 scans apart: mean, 95 % [m] (interval of the mean) | all: mean [m], [deg] | loop, finish [s] |"
    )
    print("|---|---|---|---|---|")
    for name in ("intel", "aces"):
        rows = []
        for seed in range(seeds):
            done = worlds.slam(worlds.recorded(name), seed, particles=particles, smooth=smooth)
            s = worlds.relation_spread(name, done)
            rows.append((s["far"].mean, s["far"].q95, s["all"].mean, s["rotation"].mean))
            far = s["far"]
            print(
                f"| {name} | {seed} | {far.mean:.4f}, {far.q95:.3f} ({far.low:.4f} .. {far.high:.4f}) |"
                f" {s['all'].mean:.4f}, {s['rotation'].mean:.3f} | {done.seconds['loop']:.2f}, {done.seconds['finish']:.2f} |"
            )
        far_mean, far_q95, all_mean, all_deg = np.mean(rows, axis=0)
        print(f"| {name} | mean | {far_mean:.4f}, {far_q95:.3f} | {all_mean:.4f}, {all_deg:.3f} | |")
    print(
        "\n| log | seed | ATE against the GMapping log, the other track [m] | doubled walls, ours and theirs | loop, finish [s] |"
    )
    print("|---|---|---|---|---|")
    for seed in range(seeds):
        done = worlds.slam(worlds.recorded("csail"), seed, particles=particles, smooth=smooth)
        mine, theirs = worlds.csail_doubled(done)
        print(
            f"| csail | {seed} | {worlds.csail_ate(done):.3f}, {worlds.csail_ate_other(done):.3f} |"
            f" {mine:.3f}, {theirs:.3f} | {done.seconds['loop']:.2f}, {done.seconds['finish']:.2f} |"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
