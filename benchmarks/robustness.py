"""Scanners, slipping wheels, people and long loops: share of consistent maps over ten seeds of log and filter.

python benchmarks/robustness.py [seeds]
"""

import sys

import numpy as np
import worlds

SCENARIOS = [
    "office",
    "half-degree",
    "quarter-degree",
    "narrow-view",
    "full-circle",
    "off-centre",
    "slips",
    "wheel-5-percent",
    "people",
    "loop-500m",
    "loop-2km",
]


def main(seeds: int = 10) -> None:
    """Print a row per scenario."""
    print("| scenario | consistent (Wilson 95 %) | IoU | ATE [m] median, max | loop [s] |")
    print("|---|---|---|---|---|")
    for name in SCENARIOS:
        rows = []
        for seed in range(seeds):
            log = worlds.simulated(name, seed)
            done = worlds.slam(log, seed, True)
            verdict = worlds.judge_simulated(log, done)
            rows.append((verdict.consistent, verdict.iou, verdict.ate_m, done.seconds["loop"]))
        good = sum(bool(r[0]) for r in rows)
        low, high = worlds.wilson(good, seeds)
        _, iou, ate, loop = np.array(rows, float).T
        print(
            f"| {name} | {good}/{seeds} ({low:.2f} .. {high:.2f}) | {iou.mean():.3f} | {np.median(ate):.3f}, {ate.max():.3f} |"
            f" {loop.mean():.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
