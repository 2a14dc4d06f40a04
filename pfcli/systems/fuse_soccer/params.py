"""Parameters of `fuse-soccer`."""

from dataclasses import dataclass
from typing import Annotated

from pfcli.params import Opt
from pfcli.systems.shared.shared_params import XyOfAnyStep, XyPerM, XyPerRad, YawOfAnyStep, YawPerM, YawPerRad


@dataclass(frozen=True, kw_only=True)
class Params:
    """Defaults hold for middle-size-league robots; `--variant paper` takes what the paper prints and leaves the rest alone."""

    variant: Annotated[
        str,
        Opt(
            "paper: eq. (9) alone, multinomial every time, a share of new particles, best particle; corrected: false points"
            " as well, both sides of the field in every particle, refined proposals, densest hypothesis",
            choices=("corrected", "paper"),
        ),
    ] = "corrected"
    field: Annotated[str, Opt("a field that comes with pfcli (msl-18x12, msl-22x14), or a YAML file")] = "msl-18x12"
    particles: Annotated[int, Opt("particles", "", 1, 1_000_000)] = 500
    start_particles: Annotated[int, Opt("poses tried where the robot may be anywhere", "", 10, 1_000_000)] = 6000
    compass: Annotated[bool, Opt("use the compass; without it both sides of the field are reported")] = True
    compass_sigma_deg: Annotated[
        float, Opt("spread of a reading of the compass that does not say its own", "deg", 0.1, 180)
    ] = 10.0
    compass_outliers: Annotated[float, Opt("share of readings that iron bends", "", 1e-6, 0.999)] = 0.05
    compass_memory_s: Annotated[
        float, Opt("readings within this time count as one: iron bends them alike", "s", 0, 1000)
    ] = 1.0
    side_fade_per_s: Annotated[
        float, Opt("what is known of the side of the field fades so fast: robots are carried (corrected)", "1/s", 0, 1)
    ] = 0.002
    compass_bias: Annotated[bool, Opt("learn the bias of the compass while driving")] = True
    compass_north_deg: Annotated[
        float,
        Opt("bearing of north on the field, counter-clockwise from x (90: the compass's own frame)", "deg", -360, 360),
    ] = 90.0
    vision: Annotated[bool, Opt("use line points and landmarks")] = True
    confidence: Annotated[
        str, Opt("of a point: looked up, or every line looked at each time", choices=("table", "exact"))
    ] = "table"
    sigma: Annotated[
        str, Opt("spread of line points by range: RANGE:SIGMA,... in m, straight in between (calibrate-omni finds it)")
    ] = "0:0.04,1:0.05,6.5:0.28"
    max_range_m: Annotated[float, Opt("use points up to this range", "m", 0.1, 100)] = 6.5
    points: Annotated[int, Opt("points of a frame that are used", "", 1, 100_000)] = 100
    hit: Annotated[float, Opt("share of points that are on lines (corrected)", "", 0.01, 0.999)] = 0.8
    reach_m: Annotated[float, Opt("how far from lines other points lie", "m", 0.1, 10)] = 1.0
    independent_points: Annotated[
        float, Opt("how many independent points a frame is worth at the most (corrected)", "", 0.1, 1e5)
    ] = 80.0
    missed: Annotated[
        bool, Opt("lines that ought to be seen and are not count as well: the third part of the model")
    ] = False
    miss: Annotated[float, Opt("share of the lines in view that vision does not report", "", 0.01, 0.99)] = 0.5
    refine: Annotated[
        float, Opt("share of particles proposed by error minimisation; 0: none (corrected)", "", 0, 10)
    ] = 0.2
    lost_fit: Annotated[
        float,
        Opt(
            "lost is whose points have less than this share of the best evidence; 0: never looks (corrected)", "", 0, 1
        ),
    ] = 0.1
    lost_share: Annotated[float, Opt("a lost robot may be anywhere with this probability (corrected)", "", 1e-9, 1)] = (
        0.01
    )
    new_share: Annotated[float, Opt("share of new particles in every update (paper)", "", 0, 0.9)] = 0.05
    wheel_bias: Annotated[float, Opt("mean of a wheel's error per way", "m/m", -1, 1)] = 0.0
    wheel_noise: Annotated[float, Opt("spread of a wheel's error per way", "m/m", 0, 10)] = 0.1
    wheel_noise_m: Annotated[float, Opt("spread of a wheel's error in any step", "m", 0, 10)] = 0.005
    slip_gain: Annotated[float, Opt("wheels that contradict each other are less certain by so much", "m/m", 0, 100)] = (
        2.0
    )
    adapt: Annotated[
        bool, Opt("widen the motion's errors while the lines are not where they were predicted (corrected)")
    ] = True
    resample_threshold: Annotated[
        float, Opt("without proposals, resample when N_eff falls below this share (corrected)", "", 0, 1)
    ] = 0.5
    estimate: Annotated[
        str, Opt("what is reported: mean of the densest hypothesis, or the best particle", choices=("mean", "best"))
    ] = "mean"
    motion_xy_per_m: XyPerM = 0.1
    motion_xy_per_rad_m: XyPerRad = 0.02
    motion_xy_m: XyOfAnyStep = 0.005
    motion_yaw_per_rad: YawPerRad = 0.1
    motion_yaw_per_m_rad: YawPerM = 0.05
    motion_yaw_rad: YawOfAnyStep = 0.003
