"""Scanners, slipping wheels, people and long loops: share of consistent maps over ten seeds of log and filter.

The filter and --smooth. python benchmarks/robustness.py [seeds] [scenario ...]
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


def main(seeds: int = 10, names: list[str] | None = None) -> None:
    """Print two rows per scenario."""
    print("| scenario | | consistent (Wilson 95 %) | IoU | ATE [m] median, max | loop, finish [s] |")
    print("|---|---|---|---|---|---|")
    for name in names or SCENARIOS:
        for smooth in (False, True):
            rows = []
            for seed in range(seeds):
                log = worlds.simulated(name, seed)
                done = worlds.slam(log, seed, True, smooth=smooth)
                verdict = worlds.judge_simulated(log, done)
                spent = done.seconds["loop"], done.seconds["finish"]
                rows.append((verdict.consistent, verdict.iou, verdict.ate_m, *spent))
            good = sum(bool(r[0]) for r in rows)
            low, high = worlds.wilson(good, seeds)
            _, iou, ate, loop, finish = np.array(rows, float).T
            print(
                f"| {name} | {'--smooth' if smooth else 'filter'} | {good}/{seeds} ({low:.2f} .. {high:.2f}) | {iou.mean():.3f} |"
                f" {np.median(ate):.3f}, {ate.max():.3f} | {loop.mean():.1f}, {finish.mean():.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10, sys.argv[2:] or None)
