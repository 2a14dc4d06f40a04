"""`localize-reliable`: pose, beam classes and success together (Akai 2023)."""

from pfcli.systems.localize_reliable.params import Params
from pfcli.systems.shared.chart import N_EFF, Chart, Series, one
from pfcli.systems.shared.contract import Example, System

SYSTEM = System(
    name="localize-reliable",
    summary="A pose that says whether it can be trusted, which beams the map explains, and finds itself again.",
    params=Params,
    filter="pfcli.systems.localize_reliable.filter:FILTER",
    needs=(frozenset({"motion", "scan"}),),
    map=True,
    frame="given",
    charts=(
        one("p(success)", "p_success", low=0.0, high=1.0),
        Chart(
            "protection level",
            (Series("protection", "protection_m"), Series("deviation", "sd_m", thin=True)),
            "m",
            low=0.0,
        ),
        Chart(
            "share of the beams",
            (Series("unknown", "unknown_share"), Series("misaligned", "misaligned")),
            low=0.0,
            high=1.0,
        ),
        Chart("global samples", (Series("drawn", "gl_drawn"),), kind="bars", low=0.0),
        Chart("weight that global samples won", (Series("weight", "gl_mass"),), low=0.0, high=1.0),
        N_EFF,
    ),
    classes=("doubted", "trusted"),
    confidence="p_success",
    equations=5,
    example=Example("kidnapped.mcap", ("--end", "30"), "kidnapped.yaml"),
)
