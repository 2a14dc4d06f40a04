"""Random numbers that depend on seed, purpose and stamp only, so that adding a topic shifts no other noise."""

import hashlib
from enum import IntEnum

import numpy as np


class Purpose(IntEnum):
    """What a draw of ours is for. Append only, below 2**16: the numbers are part of every recorded result."""

    INIT = 0
    MOTION = 1
    PROPOSAL = 2
    RESAMPLE = 3
    DISPERSE = 4
    SIMULATE = 5
    BOOTSTRAP = 6
    INJECT = 7
    CALIBRATE = 8
    SMOOTH = 9
    SETTLED = 11


_OURS = 1 << 16
"""Purposes below are ours."""


def purpose_of(distribution: str, name: str) -> int:
    """What a draw of another package is for: a number that its distribution and this name alone decide, never one of ours.

    Two names of one system meet with a chance of 2e-10; two systems never run on the same draws.
    """
    word = int.from_bytes(hashlib.sha256(f"{distribution}:{name}".encode()).digest()[:8], "big")
    return _OURS + word % ((1 << 32) - _OURS)


def rng_for(seed: int, purpose: int, stamp_ns: int, k: int = 0) -> np.random.Generator:
    """Generator for the k-th draw of a purpose (one of ours, or of `purpose_of`) at a stamp."""
    stamp = stamp_ns & ((1 << 64) - 1)
    sequence = np.random.SeedSequence(seed, spawn_key=(int(purpose), stamp & 0xFFFFFFFF, stamp >> 32, k))
    return np.random.Generator(np.random.PCG64(sequence))


class Draw:
    """Hands out generators and counts how often a purpose was asked for at a stamp."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._stamp_ns = -1
        self._counts: dict[int, int] = {}

    def __call__(self, purpose: int, stamp_ns: int) -> np.random.Generator:
        """Generator of the next draw for this purpose at this stamp."""
        if stamp_ns != self._stamp_ns:
            self._stamp_ns = stamp_ns
            self._counts.clear()
        k = self._counts.get(purpose, 0)
        self._counts[purpose] = k + 1
        return rng_for(self._seed, purpose, stamp_ns, k)
