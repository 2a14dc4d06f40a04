"""`slam-gdr`: Rao-Blackwellised grid SLAM with Gaussian distributed resampling (Zhang 2016)."""

from pfcli.systems import slam_landmarks
from pfcli.systems.shared.chart import ANCESTORS, N_EFF, RESAMPLED, Chart, Series, one
from pfcli.systems.shared.contract import Example, System
from pfcli.systems.slam_gdr.params import Params

SYSTEM = System(
    name="slam-gdr",
    summary="Rao-Blackwellised SLAM with Gaussian distributed resampling, from laser scans or landmarks.",
    params=Params,
    filter="pfcli.systems.slam_gdr.filter:FILTER",
    needs=(frozenset({"motion", "scan"}),),
    charts=(
        N_EFF,
        RESAMPLED,
        ANCESTORS,
        one("share of beams that match the map", "match_inliers", low=0.0, high=1.0),
        Chart(
            "spread",
            (Series("particles", "particle_spread_m"), Series("offspring", "offspring_spread_m")),
            "m",
            low=0.0,
        ),
        one("tiles of the maps", "tiles", low=0.0),
    ),
    codes={
        "slam-gdr:W1": "closures contradict each other",
        "slam-gdr:W2": "odometry and scans are of different moments",
    },
    equations=5,
    example=Example(
        "small-loop.mcap", ("--end", "50", "--particles", "6", "--resample-threshold", "0.9", "--no-smooth")
    ),
    variants={"landmarks": slam_landmarks.SYSTEM},
)
