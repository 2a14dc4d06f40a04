"""`localize-lookup`: headings from one match, ranges from a precomputed table (Zhang 2014)."""

from pfcli.systems.localize_lookup.params import Params
from pfcli.systems.shared.chart import MODE, N_EFF, RESAMPLED, SPREAD, one
from pfcli.systems.shared.contract import Example, System

SYSTEM = System(
    name="localize-lookup",
    summary="Global localisation: headings from one match, ranges from a precomputed table.",
    params=Params,
    filter="pfcli.systems.localize_lookup.filter:FILTER",
    needs=(frozenset({"motion", "scan"}), frozenset({"motion", "range"})),
    map=True,
    frame="given",
    charts=(
        MODE,
        one("modes", "modes", low=0.0),
        SPREAD,
        one("share of ranges outside the table", "missed", low=0.0),
        N_EFF,
        RESAMPLED,
    ),
    equations=5,
    example=Example(
        "four-rooms.mcap", ("--end", "25", "--wheel-radius-m", "0.1", "--track-width-m", "0.33"), "four-rooms.yaml"
    ),
)
