"""`fuse-soccer`: omni wheels, omnidirectional vision and compass on a field (Zhang 2011)."""

from pfcli.systems.fuse_soccer.params import Params
from pfcli.systems.shared.chart import DEGREES, N_EFF, SPREAD, Chart, Series, one
from pfcli.systems.shared.contract import Example, System

SYSTEM = System(
    name="fuse-soccer",
    summary="A soccer robot on its field, from wheels, field lines and landmarks, and a compass.",
    params=Params,
    filter="pfcli.systems.fuse_soccer.filter:FILTER",
    needs=(frozenset({"motion", "lines"}), frozenset({"motion", "landmarks"})),
    wants=("lines", "landmarks", "compass"),
    frame="given",
    readings="frames",
    unusable="says where to start: no points within --max-range-m, no landmark of --field; see --initial",
    charts=(
        one("probability of the other side", "mirror_p", low=0.0, high=1.0),
        Chart(
            "compass",
            (Series("residual", "compass_residual_rad", DEGREES), Series("bias", "compass_bias_rad", DEGREES)),
            "deg",
        ),
        Chart("seen", (Series("line points", "points"), Series("landmarks", "landmarks")), low=0.0),
        SPREAD,
        one("slip of the wheels", "slip_m", "m", low=0.0),
        one("injected", "injected", kind="bars", low=0.0),
        N_EFF,
    ),
    equations=5,
    example=Example("soccer.mcap", ("--end", "8", "--drive", "soccer.toml")),
)
