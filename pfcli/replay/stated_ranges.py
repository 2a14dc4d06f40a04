"""The usable range of scanners whose messages state a larger one: readings that mean 'nothing came back' are no walls."""

from collections.abc import Sequence

import numpy as np

from pfcli.core.sensor import no_return
from pfcli.dropped import Dropped
from pfcli.events import Scan
from pfcli.findings import Finding
from pfcli.formats.reader import Reader, Wanted
from pfcli.replay.reorder import Source

_PIECES, _ROWS = 6, 100
"""So many pieces, spread over the recording, are looked at, and so many scans of each batch."""


def tops(reader: Reader, sources: Sequence[Source], dropped: Dropped) -> dict[int, float]:
    """Channel -> usable range (m) where it is less than what the messages state; noted as a finding."""
    found = {}
    for source in sources:
        if source.role != "scan" or not source.channel.schema_name.endswith("LaserScan"):
            continue
        ranges, stated = _sample(reader, source)
        band = no_return.band(ranges, stated) if ranges.size else None
        if band is None or band.first_m >= stated:
            continue
        found[source.channel.id] = no_return.below(band.first_m)
        dropped.find(
            Finding(
                code="W306",
                severity="note",
                where=source.where,
                seen=f"{band.readings} of {ranges.size} sampled readings lie at {band.first_m:.3f}-{band.last_m:.3f} m, and"
                f" {band.above} above; the messages state a range_max of {stated:g} m",
                effect=f"they mean that nothing came back: the usable range is {found[source.channel.id]:.3f} m",
                way_out="--max-range-m sets it",
            )
        )
    return found


def _sample(reader: Reader, source: Source) -> tuple[np.ndarray, float]:
    """Readings of scans spread over the recording, and the largest range that is stated; no readings where the driver marks
    what did not come back itself: with infinity, or a value at or beyond range_max."""
    pieces: list[np.ndarray] = []
    stated = 0.0
    for batch in reader.batches(Wanted(frozenset({source.channel.id}), pieces=_PIECES)):
        picked = np.flatnonzero(batch.channel == source.channel.id)
        for k in picked[:: max(1, len(picked) // _ROWS)].tolist():
            try:
                scan, _ = source.decode(batch.data, int(batch.offset[k]), int(batch.length[k]), int(batch.log_ns[k]))
            except (ValueError, KeyError, OverflowError):
                continue
            if not isinstance(scan, Scan):
                continue
            stated = max(stated, scan.range_max_m if scan.range_max_m > 0 else np.inf)
            if (scan.ranges_m >= stated).any():
                return np.empty(0, np.float32), stated
            pieces.append(np.array(scan.ranges_m, np.float32))
    return np.concatenate(pieces) if pieces else np.empty(0, np.float32), stated or np.inf
