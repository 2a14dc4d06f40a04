"""`slam-gdr --landmarks`: FastSLAM with Gaussian distributed resampling (Zhang 2016)."""

from pfcli.systems.shared.chart import ANCESTORS, N_EFF, RESAMPLED, SPREAD, Chart, Series
from pfcli.systems.shared.contract import Example, System
from pfcli.systems.slam_landmarks.params import Params

SYSTEM = System(
    name="slam-gdr --landmarks",
    summary="Use detections of landmarks instead of laser scans.",
    params=Params,
    filter="pfcli.systems.slam_landmarks.filter:FILTER",
    needs=(frozenset({"motion", "landmarks"}),),
    readings="frames",
    unusable="holds a detection within --landmark-range-m (of a known landmark, with --landmark-map)",
    charts=(
        N_EFF,
        RESAMPLED,
        ANCESTORS,
        Chart("landmarks", (Series("in the map", "landmarks"), Series("detected", "detections")), low=0.0),
        SPREAD,
        Chart("NEES", (Series("NEES", "nees"),), low=0.0, high=12.0, table="track"),
    ),
    equations=5,
    example=Example("landmarks.mcap", ("--end", "25", "--rejuvenate-steps", "40")),
)
