"""Parameters of `slam-gdr --landmarks`."""

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
)


@dataclass(frozen=True, kw_only=True)
class Params:
    """Defaults hold for robots that see landmarks at some metres; detections that say their own spread keep it."""

    particles: Annotated[int, Opt("number of particles", "", 1, 100_000)] = 20
    variant: Annotated[
        str, Opt("paper: dispersal alpha / w_i as printed; corrected: alpha / (N w_i)", choices=("corrected", "paper"))
    ] = "corrected"
    proposal: Annotated[
        str,
        Opt("where particles are drawn: by motion, or by motion and detections", choices=("fastslam2", "fastslam1")),
    ] = "fastslam2"
    association: Annotated[
        str,
        Opt(
            "which landmark a detection is of: by its id, by likelihood, or by id where all have one",
            choices=("auto", "known", "unknown"),
        ),
    ] = "auto"
    reject_gate: Annotated[
        float, Opt("squared distance within which a detection may be of a landmark", "", 0.1, 1e4)
    ] = 4.0
    augment_gate: Annotated[float, Opt("squared distance beyond which it is of a new one", "", 0.1, 1e6)] = 25.0
    landmark_map: Annotated[str, Opt("CSV with id,x_m,y_m of known landmarks: localisation instead of SLAM")] = ""
    range_sigma_m: Annotated[float, Opt("spread of a range that does not say its own", "m", 1e-4, 100)] = 0.1
    range_sigma_share: Annotated[float, Opt("and its share of the range", "", 0, 1)] = 0.0
    bearing_sigma_deg: Annotated[float, Opt("spread of a bearing that does not say its own", "deg", 1e-4, 90)] = 1.0
    landmark_range_m: Annotated[float, Opt("use detections up to this range", "m", 0.1, 1e5)] = 100.0
    false_share: Annotated[float, Opt("share of detections that are of nothing", "", 1e-9, 0.99)] = 1e-4
    spurious_m: Annotated[
        float,
        Opt(
            "a landmark within this range that is not seen loses evidence (unknown association); 0: never", "m", 0, 1e5
        ),
    ] = 0.0
    rejuvenate_steps: Annotated[
        int,
        Opt(
            "after so many observations, or when a landmark comes back that was not seen for so many, particles are drawn"
            " anew from all that was driven and seen; 0: never",
            "",
            0,
            1_000_000,
        ),
    ] = 10
    smooth: Smooth = False
    calibrate: Annotated[
        bool,
        Opt(
            "among known landmarks: learn how far ranges, bearings, ways and turns are off, whenever particles are drawn anew"
        ),
    ] = True
    resampler: Resampler = "gdr"
    sort: Sort = "descending"
    resample_threshold: Annotated[float, Opt("resample when N_eff falls below this share of N", "", 0, 1)] = 0.75
    alpha_xy_m: AlphaXy = 0.005
    alpha_yaw_deg: AlphaYaw = 0.02
    dispersal_cap: DispersalCap = 9.0
    disperse_first: DisperseFirst = False
    motion_xy_per_root_m: Annotated[
        float, Opt("odometry: position error of a metre, growing with the root of the way", "m", 0, 10)
    ] = 0.05
    motion_xy_m: SomeXyOfAnyStep = 0.005
    motion_yaw_per_root_m: Annotated[
        float, Opt("odometry: heading error of a metre, growing with the root of the way", "rad", 0, 10)
    ] = 0.02
    motion_yaw_per_root_rad: Annotated[
        float, Opt("odometry: heading error of a radian, growing with the root of the turn", "rad", 0, 10)
    ] = 0.1
    motion_yaw_rad: SomeYawOfAnyStep = 0.003
    motion_across_share: Annotated[
        float,
        Opt("errors across the way as a share of those along it: a wheeled robot hardly slips sideways", "", 1e-3, 100),
    ] = 1.0
    motion_pivot_m: Annotated[
        float, Opt("errors of turning are about a point so far behind: a car's rear axle", "m", 0, 100)
    ] = 0.0
