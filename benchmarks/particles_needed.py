"""Share of consistent maps by number of particles, GDR beside systematic resampling and --smooth (Zhang 2016, tables 2 and 3).

'Consistent' is frozen in docs/decisions/005-consistent-map.md. python benchmarks/particles_needed.py [seeds] [world ...]
"""

import sys

import numpy as np
import worlds

WORLDS = ["paper-40x25", "paper-40x25-long", "paper-60x50", "paper-60x50-long", "csail"]


def main(seeds: int = 10, names: list[str] | None = None) -> None:
    """Print a row per world, resampler and N."""
    print(
        "| world | N | resampler | consistent (Wilson 95 %) | IoU | doubled walls above truth | ATE [m] | resamplings |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for world in names or WORLDS:
        log = worlds.recorded("csail") if world == "csail" else worlds.simulated(world)
        for n in (2, 5, 10, 20, 50):
            for variant in ("gdr", "systematic", "gdr --smooth"):
                resampler, _, smooth = variant.partition(" ")
                rows = []
                for seed in range(seeds):
                    done = worlds.slam(
                        log, seed, world != "csail", particles=n, resampler=resampler, smooth=bool(smooth)
                    )
                    if world == "csail":
                        ate = worlds.csail_ate(done)
                        verdict = worlds.Verdict(ate <= worlds.CSAIL_ATE_M, np.nan, np.nan, ate)
                    else:
                        verdict = worlds.judge_simulated(log, done)
                    rows.append((*verdict, done.result.summary["resamplings"]))
                good = sum(bool(r[0]) for r in rows)
                low, high = worlds.wilson(good, seeds)
                iou, doubled, ate, resamplings = np.mean([r[1:] for r in rows], axis=0)
                print(
                    f"| {world} | {n} | {variant} | {good}/{seeds} ({low:.2f} .. {high:.2f}) | {iou:.3f} | {doubled:.3f} |"
                    f" {ate:.3f} | {resamplings:.1f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10, sys.argv[2:] or None)
