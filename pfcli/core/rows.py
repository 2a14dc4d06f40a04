"""Rows that are collected one by one over hours: as arrays, for a list of tuples takes ten times the memory."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_BLOCK = 4096


class Rows:
    """Rows of one shape and type: `append`, then `array()`, (n, *shape)."""

    def __init__(self, shape: tuple[int, ...] = (), dtype: Any = np.float64) -> None:
        self._shape, self._dtype = shape, np.dtype(dtype)
        self._blocks: list[NDArray[Any]] = []
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, row: ArrayLike) -> None:
        """Add one row."""
        at = self._count % _BLOCK
        if at == 0:
            self._blocks.append(np.empty((_BLOCK, *self._shape), self._dtype))
        self._blocks[-1][at] = row
        self._count += 1

    def extend(self, rows: NDArray[Any]) -> None:
        """Add several rows."""
        for row in rows:
            self.append(row)

    def last(self) -> NDArray[Any]:
        """A view of the row that was added last. Raises IndexError where there is none."""
        return self._blocks[-1][(self._count - 1) % _BLOCK]  # type: ignore[no-any-return]

    def set_last(self, row: ArrayLike) -> None:
        """Replace the row that was added last."""
        self._blocks[-1][(self._count - 1) % _BLOCK] = row

    def array(self) -> NDArray[Any]:
        """All rows, copied."""
        if not self._blocks:
            return np.empty((0, *self._shape), self._dtype)
        return np.concatenate(self._blocks)[: self._count]
