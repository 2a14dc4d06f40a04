"""The landmarks of all particles in blocks that particles share until one of them changes its block.

Resampling copies one number for 16 landmarks of a particle, not the landmarks: that is as good as flat, where a tree
(Montemerlo 2003) is logarithmic.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.jit import inline_kernel, kernel, put

BLOCK, FIELDS = 16, 7
"""A landmark is x, y, pxx, pxy, pyy, sightings, evidence; sightings 0: there is none."""


class Store(NamedTuple):
    """table (n, b): block of each particle's landmarks 16 k .. 16 k + 15, -1 where there is none; pool (cap, BLOCK, FIELDS);
    refs (cap,): how many rows of the table point there; free (cap,): a stack of unused blocks; top (1,): its height."""

    table: NDArray[np.int32]
    pool: NDArray[np.float64]
    refs: NDArray[np.int32]
    free: NDArray[np.int32]
    top: NDArray[np.int64]


def empty(n: int) -> Store:
    """No landmarks for n particles: an index (n, 0) and no block."""
    return Store(
        np.empty((n, 0), np.int32),
        np.empty((0, BLOCK, FIELDS)),
        np.empty(0, np.int32),
        np.empty(0, np.int32),
        np.zeros(1, np.int64),
    )


def reserve(store: Store, columns: int) -> Store:
    """Room for landmarks 0 .. columns - 1 in every one of the n particles, even if no block were shared."""
    n, have = store.table.shape
    blocks = -(-columns // BLOCK)
    if blocks <= have:
        return store
    blocks = max(blocks, 2 * have)
    old, cap = store.refs.size, n * blocks
    table = np.full((n, blocks), -1, np.int32)
    table[:, :have] = store.table
    pool = np.zeros((cap, BLOCK, FIELDS))
    pool[:old] = store.pool
    refs = np.zeros(cap, np.int32)
    refs[:old] = store.refs
    free = np.empty(cap, np.int32)
    top = int(store.top[0])
    free[:top] = store.free[:top]
    free[top : top + cap - old] = np.arange(cap - 1, old - 1, -1)
    return Store(table, pool, refs, free, np.array([top + cap - old]))


def of_particles(marks: NDArray[np.float64], n: int) -> Store:
    """A store of n particles with the landmarks (m, l, FIELDS) of the first m."""
    store = reserve(empty(n), marks.shape[1])
    padded = np.zeros((marks.shape[0], store.table.shape[1] * BLOCK, FIELDS))
    padded[:, : marks.shape[1]] = marks
    for i in range(marks.shape[0]):
        for b in range(store.table.shape[1]):
            store.top[0] -= 1
            block = int(store.free[store.top[0]])
            store.pool[block] = padded[i, b * BLOCK : (b + 1) * BLOCK]
            store.refs[block], store.table[i, b] = 1, block
    return store


@inline_kernel
def read(store, i, column):
    """(block, row) of a particle's landmark; block -1 where there is none."""
    block = store.table[i, column // BLOCK]
    row = column % BLOCK
    if block >= 0 and store.pool[block, row, 5] == 0.0:
        return -1, row
    return block, row


@inline_kernel
def own(store, i, column):
    """The block of a particle's landmark, its alone to write."""
    table, pool, refs, free, top = store
    b = column // BLOCK
    block = table[i, b]
    if block >= 0 and refs[block] == 1:
        return block
    top[0] -= 1
    fresh = free[top[0]]
    if block >= 0:
        put(pool[fresh], pool[block])
        refs[block] -= 1
    else:
        pool[fresh] = 0.0
    refs[fresh] = 1
    table[i, b] = fresh
    return fresh


@kernel
def _choose(table, ancestors, refs, free, top):
    out = table[ancestors]
    refs[:] = 0
    for i in range(out.shape[0]):
        for b in range(out.shape[1]):
            if out[i, b] >= 0:
                refs[out[i, b]] += 1
    top[0] = 0
    for k in range(refs.size - 1, -1, -1):
        if refs[k] == 0:
            free[top[0]] = k
            top[0] += 1
    return out


def choose(store: Store, ancestors: NDArray[np.int64]) -> Store:
    """The store after resampling by ancestors int64 (n,)."""
    return store._replace(table=_choose(store.table, ancestors, store.refs, store.free, store.top))


def landmarks(store: Store, i: int) -> NDArray[np.float64]:
    """(columns, FIELDS) landmarks of particle i; rows with no sightings are none."""
    out = np.zeros((store.table.shape[1] * BLOCK, FIELDS))
    for b, block in enumerate(store.table[i].tolist()):
        if block >= 0:
            out[b * BLOCK : (b + 1) * BLOCK] = store.pool[block]
    return out
