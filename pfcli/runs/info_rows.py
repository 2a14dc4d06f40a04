"""The rows of `metrics.parquet` while a run goes on: columns of numbers that are given back as `Info` tuples."""

from array import array
from collections.abc import Iterator, Sequence
from typing import Any, get_type_hints, overload

import numpy as np

_CODES = {int: "q", float: "d", bool: "b"}


class InfoRows(Sequence[Any]):
    """A sequence of NamedTuples of the type `kind`; what is no plain number by its annotation is kept as it is."""

    def __init__(self, kind: Any) -> None:
        self._kind = kind
        self._types = list(get_type_hints(kind).values())
        self._columns: list[Any] = [array(_CODES[t]) if t in _CODES else [] for t in self._types]

    def append(self, row: Any) -> None:
        """Add a row."""
        for column, value in zip(self._columns, row, strict=True):
            column.append(value if not isinstance(value, np.bool_) else bool(value))

    def __len__(self) -> int:
        return len(self._columns[0])

    def __iter__(self) -> Iterator[Any]:
        return (self._row(k) for k in range(len(self)))

    @overload
    def __getitem__(self, index: int) -> Any: ...
    @overload
    def __getitem__(self, index: slice) -> list[Any]: ...
    def __getitem__(self, index: int | slice) -> Any:
        if isinstance(index, slice):
            return [self._row(k) for k in range(*index.indices(len(self)))]
        return self._row(index)

    def _row(self, k: int) -> Any:
        return self._kind(*(bool(c[k]) if t is bool else c[k] for t, c in zip(self._types, self._columns, strict=True)))
