"""What sorting, dispersal and the threshold do: N = 5, 10, 20, 50, ten paired seeds, all else identical.

Sharp weights (`--evidence-gain 0.1`) make the filter resample often, as the paper's does; with the default it hardly does in
so short a drive, and two variants are enough.
python benchmarks/ablation.py [seeds]
"""

import sys
from typing import Any

import numpy as np
import worlds

VARIANTS = {
    "GDR (sort, dispersal)": {"resampler": "gdr"},
    "no sort": {"resampler": "gdr", "sort": "none"},
    "no dispersal (CSW)": {"resampler": "csw"},
    "neither (systematic)": {"resampler": "systematic"},
    "GDR as printed": {"resampler": "gdr", "variant": "paper"},
}


THRESHOLDS = (0.25, 0.5, 0.75, 0.9)


def row(label: str, seeds: int, **params: Any) -> None:
    """Run the small loop over the seeds and print one line."""
    small = worlds.simulated("small-loop")
    ate, resamplings, spread, shared = [], [], [], []
    for seed in range(seeds):
        done = worlds.slam(small, seed, True, **params)
        assert done.errors is not None
        ate.append(done.errors.summary()["ate_m"])
        resamplings.append(done.result.summary["resamplings"])
        spread += [i.offspring_spread_m for i in done.infos if i.resampled]
        shared.append(done.result.summary["updates_shared_by_all"] / len(done.infos))
    print(
        f"| {label} | {np.mean(ate):.4f} +- {np.std(ate):.4f} | {np.mean(resamplings):.1f} |"
        f" {np.mean(spread) if spread else 0.0:.4f} | {np.mean(shared):.2f} |",
        flush=True,
    )


def main(seeds: int = 10) -> None:
    """Print ATE, resamplings, spread of the offspring and shared history on the ring corridor of the samples."""
    print(
        "| N | variant | evidence gain | small loop: ATE [m] mean +- sd | resamplings | offspring spread [m] | shared by all |"
    )
    print("|---|---|---|---|---|---|---|")
    for n in (5, 10, 20, 50):
        for name, change in VARIANTS.items():
            row(f"{n} | {name} | 0.1", seeds, particles=n, evidence_gain=0.1, **change)
        for name in ("GDR (sort, dispersal)", "neither (systematic)"):
            row(f"{n} | {name} | 0.01", seeds, particles=n, evidence_gain=0.01, **VARIANTS[name])
    for threshold in THRESHOLDS:
        row(
            f"10 | GDR, threshold {threshold:g} | 0.1",
            seeds,
            particles=10,
            evidence_gain=0.1,
            resample_threshold=threshold,
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
