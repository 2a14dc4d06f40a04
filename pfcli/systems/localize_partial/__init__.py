"""`localize-partial`: Monte Carlo localisation in an incomplete map (Zhang 2010)."""

from pfcli.systems.localize_partial.params import Params
from pfcli.systems.shared.chart import N_EFF, SPREAD, Chart, Series
from pfcli.systems.shared.contract import Example, System

SYSTEM = System(
    name="localize-partial",
    summary="Monte Carlo localisation in an incomplete map: where, and is the robot in the map at all?",
    params=Params,
    filter="pfcli.systems.localize_partial.filter:FILTER",
    needs=(frozenset({"motion", "scan"}),),
    map=True,
    frame="given",
    charts=(
        Chart("probability of the states", tuple(Series(f"B{k}", f"b{k}") for k in range(1, 7)), kind="stack"),
        Chart(
            "in the map",
            (Series("filter", "in_map"), Series("smoothed", "in_map_smoothed", thin=True)),
            low=0.0,
            high=1.0,
        ),
        Chart("particles of the clusters", tuple(Series(f"C{k}", f"n{k}") for k in range(2, 7)), low=0.0),
        N_EFF,
        SPREAD,
    ),
    classes=("", "", "C2", "C3", "C4", "C5", "C6"),
    confidence="in_map",
    equations=5,
    example=Example("partial.mcap", ("--end", "25", "--particles", "3000"), "partial-partial.yaml"),
)
