"""Parameters that several systems have: their help, units and limits stand here once, their defaults with each system."""

from typing import Annotated

from pfcli.params import Opt
from pfcli.registry import resampler_names

XyPerM = Annotated[float, Opt("odometry: position error per way", "m/m", 0, 10)]
XyPerRad = Annotated[float, Opt("odometry: position error per turn", "m/rad", 0, 10)]
XyOfAnyStep = Annotated[float, Opt("odometry: position error of any step", "m", 0, 10)]
YawPerRad = Annotated[float, Opt("odometry: heading error per turn", "rad/rad", 0, 10)]
YawPerM = Annotated[float, Opt("odometry: heading error per way", "rad/m", 0, 10)]
YawOfAnyStep = Annotated[float, Opt("odometry: heading error of any step", "rad", 0, 10)]
SomeXyOfAnyStep = Annotated[float, Opt("odometry: position error of any step", "m", 1e-6, 10)]
SomeYawOfAnyStep = Annotated[float, Opt("odometry: heading error of any step", "rad", 1e-6, 10)]
"""Where the step's information is asked for, no step is certain."""

Resampler = Annotated[
    str, Opt("how offspring are chosen; gdr: csw, then dispersed", choices=("gdr", *resampler_names()))
]
PlainResampler = Annotated[str, Opt("how offspring are chosen", choices=resampler_names())]
CorrectedResampler = Annotated[str, Opt("how offspring are chosen (corrected)", choices=resampler_names())]
"""Where the paper says how: `--variant paper` does as printed."""
Sort = Annotated[str, Opt("order of the cumulative sum", choices=("descending", "none"))]
AlphaXy = Annotated[float, Opt("dispersal at average weight", "m", 0, 1)]
AlphaYaw = Annotated[float, Opt("dispersal at average weight", "deg", 0, 45)]
DispersalCap = Annotated[float, Opt("largest variance factor of the dispersal", "", 0, 1000)]
DisperseFirst = Annotated[bool, Opt("disperse the first offspring of a parent too, as the paper prints it")]
Smooth = Annotated[
    bool, Opt("track and map as the whole log knows them, relaxed over all places that were come back to")
]
