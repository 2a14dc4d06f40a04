"""The fuzz targets on their seeds, on mutations of them, and on everything that was ever found (`make fuzz` looks on)."""

from pathlib import Path

import numpy as np
import pytest

from fuzz import corpus, targets

FOUND = sorted(Path(__file__).parent.glob("found/*/*"))


@pytest.mark.parametrize("target", sorted(targets.TARGETS))
def test_seeds_are_good_and_their_mutations_are_refused_in_one_line(target: str) -> None:
    rng = np.random.default_rng(11)
    for seed in corpus.seeds(target):
        targets.TARGETS[target](seed)
        for _ in range(30):
            targets.check(target, corpus.mutated(seed, rng))


@pytest.mark.parametrize("path", FOUND, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_what_was_found_once_is_not_found_again(path: Path) -> None:
    targets.check(path.parent.name, path.read_bytes())
