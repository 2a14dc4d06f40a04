"""Parameters of `slam-gdr` on grids."""

from dataclasses import dataclass
from typing import Annotated

from pfcli.params import Opt
from pfcli.systems.shared.shared_params import (
    AlphaXy,
    AlphaYaw,
    DispersalCap,
    DisperseFirst,
    Resampler,
    Smooth,
    SomeXyOfAnyStep,
    SomeYawOfAnyStep,
    Sort,
    XyPerM,
    XyPerRad,
    YawPerM,
    YawPerRad,
)


@dataclass(frozen=True, kw_only=True)
class Params:
    """Defaults hold for indoor robots with a laser of 4 m range or more."""

    particles: Annotated[int, Opt("number of particles, each with a map of its own", "", 1, 10_000)] = 10
    variant: Annotated[
        str, Opt("paper: dispersal alpha / w_i as printed; corrected: alpha / (N w_i)", choices=("corrected", "paper"))
    ] = "corrected"
    update_distance_m: Annotated[float, Opt("a scan updates the filter after this way", "m", 0, 100)] = 0.25
    update_angle_rad: Annotated[float, Opt("or after this turn", "rad", 0, 10)] = 0.25
    resampler: Resampler = "gdr"
    sort: Sort = "descending"
    resample_threshold: Annotated[float, Opt("resample when N_eff falls below this share of N", "", 0, 1)] = 0.5
    alpha_xy_m: AlphaXy = 0.01
    alpha_yaw_deg: AlphaYaw = 0.3
    dispersal_cap: DispersalCap = 9.0
    disperse_first: DisperseFirst = False
    resolution_m: Annotated[float, Opt("side of a map cell; 0 learns it from the log", "m", 0, 1)] = 0.0
    max_range_m: Annotated[float, Opt("usable range; 0 takes it from the messages' range_max", "m", 0, 1000)] = 0.0
    max_beams: Annotated[int, Opt("use every k-th beam so that at most so many remain", "", 1, 100_000)] = 400
    clear_no_return_m: Annotated[
        float, Opt("how far a beam without a return clears the map; 0 leaves it out", "m", 0, 1000)
    ] = 0.0
    sigma_hit_m: Annotated[float, Opt("spread of end points across a surface; 0 learns it from the log", "m", 0, 1)] = (
        0.0
    )
    beam_width_deg: Annotated[float, Opt("spot of a beam: blurs surfaces seen at grazing incidence", "deg", 0, 10)] = (
        0.57
    )
    match_width_m: Annotated[float, Opt("scale of the robust matching cost at its start", "m", 0.01, 2)] = 0.3
    beam_gain: Annotated[float, Opt("how many independent beams one beam is worth", "", 1e-4, 10)] = 0.3
    evidence_gain: Annotated[
        float, Opt("share of a scan's log evidence that counts as new: successive scans err alike", "", 1e-6, 10)
    ] = 0.01
    proposal_scale: Annotated[
        float,
        Opt("sample the improved proposal with this multiple of its standard deviation; 0 takes its mode", "", 0, 10),
    ] = 0.3
    coarse_xy_m: Annotated[float, Opt("half width of the coarse search", "m", 0.01, 5)] = 0.3
    coarse_yaw_deg: Annotated[float, Opt("half width of the coarse search", "deg", 0.5, 180)] = 20.0
    rescue_inliers: Annotated[
        float, Opt("below this share of beams on known walls every particle searches farther; 0 never", "", 0, 1)
    ] = 0.6
    draw_inliers: Annotated[
        float, Opt("a scan with fewer of its beams on known walls is not drawn into that particle's map", "", 0, 1)
    ] = 0.5
    rescue_xy_m: Annotated[float, Opt("half width of that search", "m", 0.01, 10)] = 0.8
    motion_xy_per_m: XyPerM = 0.2
    motion_xy_per_rad_m: XyPerRad = 0.02
    motion_xy_m: SomeXyOfAnyStep = 0.02
    motion_yaw_per_rad: YawPerRad = 0.2
    motion_yaw_per_m_rad: YawPerM = 0.05
    motion_yaw_rad: SomeYawOfAnyStep = 0.02
    smooth: Smooth = True
