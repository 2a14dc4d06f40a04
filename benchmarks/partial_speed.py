"""Speed of localize-partial: the sensor kernel alone, and a whole update of 2 000 and 50 000 particles with 60 beams.

python benchmarks/partial_speed.py
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import partial_map

from pfcli.core import threads
from pfcli.core.sensor import likelihood_field
from pfcli.formats import map_yaml
from pfcli.initial import Initial
from pfcli.registry import system
from pfcli.rng import Draw
from pfcli.runs.loop import Job, execute
from pfcli.systems.localize_partial import filter, incomplete_map, matched_odometry, update_corrected
from pfcli.systems.localize_partial.class_belief import Belief, Reading
from pfcli.systems.localize_partial.incomplete_map import Assets
from pfcli.systems.localize_partial.params import Params


def median_ms(call: Callable[[], object], rounds: int = 100) -> float:
    """Median time of a call after three that do not count."""
    for _ in range(3):
        call()
    took = []
    for _ in range(rounds):
        began = time.perf_counter()
        call()
        took.append(time.perf_counter() - began)
    return 1e3 * float(np.median(took))


def main() -> None:
    """Print the table; numpy's look-up of the same beams stands beside the kernel."""
    log, map_file = partial_map.log_of("partial-leave", 0)
    params = Params(kld=False, resample_threshold=0.0, particles=100_000)
    assets = incomplete_map.load(
        params, Job(system("localize-partial"), params, [log], map=map_file, initial=Initial("pose", (3.0, 0.0, 0.0)))
    )
    rng = np.random.default_rng(0)
    ends = np.stack([rng.uniform(-4, 8, 60), rng.uniform(-1.2, 1.2, 60)]).astype(np.float32)
    grid = map_yaml.read(map_file)
    rows, cols = np.nonzero(grid.cells == 1)
    walls = np.column_stack([cols, rows]) * grid.resolution_m + np.array(grid.origin[:2]) - (5.0, 0.0)
    walls = walls[np.hypot(*walls.T) < 8.0]
    fitting = walls[rng.choice(walls.shape[0], 60, replace=False)].T.astype(np.float32)
    table = assets.field.table.reshape(likelihood_field.LEVELS, assets.field.rows, assets.field.cols)[0]
    print("| what | 1 thread | 2 threads | numpy, same beams |\n|---|---|---|---|")
    for n in (2_000, 50_000):
        poses = np.column_stack([rng.normal(5, 0.3, n), rng.normal(0, 0.3, n), rng.normal(0, 0.1, n)])

        def with_numpy(poses: np.ndarray = poses) -> np.ndarray:
            c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
            gx = (poses[:, 0, None] + c * ends[0] - s * ends[1] - grid.origin.x_m) / grid.resolution_m + 1
            gy = (poses[:, 1, None] + s * ends[0] + c * ends[1] - grid.origin.y_m) / grid.resolution_m + 1
            row, col = np.clip(gy.astype(int), 0, table.shape[0] - 1), np.clip(gx.astype(int), 0, table.shape[1] - 1)
            return table[row, col].sum(axis=1)

        row = []
        for count in (1, 2):
            threads.set_threads(count)
            ms = median_ms(lambda poses=poses: likelihood_field.evidence(poses, ends, assets.field))
            row.append(f"{ms:.3f} ms, {n * 60 / ms / 1e3:.0f} million particle-beams/s")
        print(f"| sensor kernel, {n} x 60 | {row[0]} | {row[1]} | {median_ms(with_numpy, 5):.2f} ms |")
        belief = Belief(poses, np.full(n, 3, np.uint8), np.full(n, 1.0 / n), np.array([0, 0, 0, 1.0, 0, 0, 0]))
        flat = np.zeros((2, 60), np.float32)
        for which, scan in (("a scan that fits", fitting), ("one that does not", ends)):
            reading = Reading(np.array([0.1, 0.0, 0.0]), False, scan, np.zeros(60, np.int32), flat, 5)
            row = []
            for count in (1, 2):
                threads.set_threads(count)
                row.append(
                    f"{median_ms(lambda b=belief, r=reading: update_corrected.update(b, r, assets, params, Draw(0))):.3f} ms"
                )
            print(f"| whole update, {n} x 60, {which} | {row[0]} | {row[1]} | |", flush=True)
    took = reckoned_ms(log, assets)
    print(f"| a scan of 181 beams matched against the last metres | {took:.3f} ms | | |")


def reckoned_ms(log: Path, assets: Assets) -> float:
    """Median time that an update of a whole drive spends on the odometry by scans."""
    took, reckon = [], matched_odometry.reckon

    def timed(*arguments: Any) -> Any:
        began = time.perf_counter()
        found = reckon(*arguments)
        took.append(time.perf_counter() - began)
        return found

    filter.reckon = timed  # type: ignore[attr-defined]
    partial = system("localize-partial")
    execute(Job(partial, Params(), [log], map=partial_map.log_of("partial-leave", 0)[1], initial=assets.initial))
    return 1e3 * float(np.median(took))


if __name__ == "__main__":
    main()
