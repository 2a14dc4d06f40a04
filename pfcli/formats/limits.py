"""What input may ask for before it is refused: sane for any recording, flags for the others."""

from typing import NamedTuple


class Limits(NamedTuple):
    """chunk_mib: records of one chunk of a log; buffer_mib: messages in the reorder buffer; map_mpx: a map's million pixels."""

    chunk_mib: float = 256
    buffer_mib: float = 1024
    map_mpx: float = 256


DEFAULTS = Limits()


class Reading(NamedTuple):
    """How containers are read. max_chunk_mib: of `Limits`; of logs that are text: range_scale multiplies their ranges,
    max_range_m is the usable range (None: told by the readings), repair_stamps mends stamps whose microseconds lost their
    zeros."""

    max_chunk_mib: float = DEFAULTS.chunk_mib
    range_scale: float = 1.0
    max_range_m: float | None = None
    repair_stamps: bool = True


AS_IT_IS = Reading()
