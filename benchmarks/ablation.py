"""What sorting and dispersal do: N = 5, 10, 20, ten paired seeds, all else identical.

Sharp weights (`--evidence-gain 0.1`) make the filter resample often, as the paper's does; the default is printed beside.
python benchmarks/ablation.py [seeds]
"""

import sys

import numpy as np
import worlds

VARIANTS = {
    "GDR (sort, dispersal)": {"resampler": "gdr"},
    "no sort": {"resampler": "gdr", "sort": "none"},
    "no dispersal (CSW)": {"resampler": "csw"},
    "neither (systematic)": {"resampler": "systematic"},
    "GDR as printed": {"resampler": "gdr", "variant": "paper"},
}


def main(seeds: int = 10) -> None:
    """Print ATE and resamplings on the ring corridor of the samples, and ACES re-visits."""
    small = worlds.simulated("small-loop")
    print(
        "| N | variant | evidence gain | small loop: ATE [m] mean +- sd | resamplings | offspring spread [m] | shared by all |"
    )
    print("|---|---|---|---|---|---|---|")
    for n in (5, 10, 20):
        for gain in (0.1, 0.01):
            for name, change in VARIANTS.items():
                ate, resamplings, spread, shared = [], [], [], []
                for seed in range(seeds):
                    done = worlds.slam(small, seed, True, particles=n, evidence_gain=gain, **change)
                    assert done.errors is not None
                    ate.append(done.errors.summary()["ate_m"])
                    resamplings.append(done.result.summary["resamplings"])
                    spread += [i.offspring_spread_m for i in done.infos if i.resampled]
                    shared.append(done.result.summary["updates_shared_by_all"] / len(done.infos))
                print(
                    f"| {n} | {name} | {gain} | {np.mean(ate):.4f} +- {np.std(ate):.4f} | {np.mean(resamplings):.1f} |"
                    f" {np.mean(spread) if spread else 0.0:.4f} | {np.mean(shared):.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
