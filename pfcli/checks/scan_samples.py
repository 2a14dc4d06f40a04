"""Scans that are kept for the checks: pairs a moment apart, spread over the whole log, however long it is."""

import numpy as np

from pfcli.events import Scan

_APART_NS = 200_000_000
_LATEST_NS = 2_000_000_000


class ScanSamples:
    """At most twice `wanted` pairs of scans, evenly spread; counts of all."""

    def __init__(self, wanted: int) -> None:
        self.pairs: list[tuple[Scan, Scan]] = []
        self.count = 0
        self._wanted, self._every, self._since = wanted, 1, 0
        self._first: Scan | None = None

    def add(self, scan: Scan) -> None:
        """The next scan."""
        self.count += 1
        first = self._first
        if first is not None and scan.stamp_ns - first.stamp_ns >= _APART_NS:
            if scan.stamp_ns - first.stamp_ns < _LATEST_NS:
                self.pairs.append((first, _own(scan)))
                if len(self.pairs) >= 2 * self._wanted:
                    self.pairs, self._every = self.pairs[::2], 2 * self._every
            self._first = first = None
        self._since += 1
        if first is None and self._since >= self._every:
            self._first, self._since = _own(scan), 0

    @property
    def scans(self) -> list[Scan]:
        """The first of every pair; of a log without pairs, the scan that waited for its partner."""
        return [first for first, _ in self.pairs] or ([self._first] if self._first is not None else [])


def _own(scan: Scan) -> Scan:
    """A copy: the ranges of a message lie in a buffer that is given back."""
    return scan._replace(ranges_m=np.array(scan.ranges_m, np.float32))
