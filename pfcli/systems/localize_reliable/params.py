"""Parameters of `localize-reliable`."""

from dataclasses import dataclass
from typing import Annotated

from pfcli.params import Opt
from pfcli.systems.shared.shared_params import (
    PlainResampler,
    XyOfAnyStep,
    XyPerM,
    XyPerRad,
    YawOfAnyStep,
    YawPerM,
    YawPerRad,
)


@dataclass(frozen=True, kw_only=True)
class Params:
    """Defaults hold for indoor robots with a laser of 4 m range or more."""

    particles: Annotated[int, Opt("particles of the pose tracker", "", 1, 1_000_000)] = 500
    start_particles: Annotated[int, Opt("particles at an unknown start", "", 1, 2_000_000)] = 200_000
    update_distance_m: Annotated[float, Opt("a scan updates the filter after this way", "m", 0, 100)] = 0.1
    update_angle_rad: Annotated[float, Opt("or after this turn", "rad", 0, 10)] = 0.1
    beams: Annotated[int, Opt("beams of a scan that are used", "", 1, 100_000)] = 60
    max_range_m: Annotated[float, Opt("use beams up to this range; 0 takes the messages' range_max", "m", 0, 1000)] = (
        0.0
    )
    sigma_hit_m: Annotated[float, Opt("spread of end points around mapped surfaces", "m", 1e-3, 10)] = 0.05
    z_hit: Annotated[float, Opt("share of hits among beams on known obstacles", "", 0.01, 1)] = 0.98
    z_rand: Annotated[float, Opt("share of readings of anything among them", "", 1e-6, 1)] = 0.02
    known_prior: Annotated[float, Opt("a beam hits a known obstacle with this probability", "", 0.01, 0.99)] = 0.5
    unknown_rate_per_m: Annotated[float, Opt("unknown obstacles: rate of their exponential", "1/m", 1e-4, 10)] = 0.2
    unknown_threshold: Annotated[float, Opt("a beam is called unknown above this posterior", "", 0, 1)] = 0.5
    independent_beams: Annotated[float, Opt("how many independent beams a scan is worth", "", 0.1, 1e4)] = 12.0
    range_model: Annotated[
        str,
        Opt(
            "residual of a beam: of its end point in the likelihood field, or of its range from the expected one",
            choices=("field", "beam"),
        ),
    ] = "field"
    mae_top_m: Annotated[float, Opt("residuals count up to this", "m", 0.01, 100)] = 1.0
    estimate_reliability: Annotated[bool, Opt("estimate p(success)")] = True
    decision_weighs: Annotated[
        bool, Opt("let p(success) weigh the particles beside the scan, as printed: the residuals then count twice")
    ] = False
    classifier: Annotated[
        str, Opt("decision model from `pfcli calibrate`; empty: learnt from the map once, and kept in the cache folder")
    ] = ""
    decision_gain: Annotated[float, Opt("how many independent decisions one scan is worth", "", 0, 10)] = 1.0
    reliability_top: Annotated[float, Opt("p(success) stays within 1 - this and this", "", 0.5, 0.9999999)] = 0.999
    track_record: Annotated[
        bool, Opt("trust less where one trusted place after the other had to be given up, as in a wrong map")
    ] = True
    decay_per_m2: Annotated[float, Opt("reliability lost by driving, squared metres", "1/m^2", 0, 100)] = 0.005
    decay_per_rad2: Annotated[float, Opt("reliability lost by turning, squared radians", "1/rad^2", 0, 100)] = 0.005
    use_gl: Annotated[bool, Opt("fuse global samples by importance sampling")] = True
    gl_gate: Annotated[bool, Opt("draw them only while p(success) < 0.5")] = False
    gl_period: Annotated[float, Opt("log time between two global samplings", "s", 0, 1e6)] = 1.0
    gl_steps: Annotated[
        int,
        Opt(
            "earlier key scans joined to the newest one for it (N); with more than 5 a sample must explain them too",
            "",
            0,
            100,
        ),
    ] = 5
    gl_samples: Annotated[int, Opt("global samples", "", 1, 100_000)] = 200
    gl_uniform: Annotated[float, Opt("share of the prediction that may be anywhere in the map", "", 1e-12, 0.5)] = 1e-5
    rivals: Annotated[
        int,
        Opt(
            "particles of hypotheses that are not believed: they keep their weight, so that evidence adds up",
            "",
            0,
            100_000,
        ),
    ] = 200
    new_only: Annotated[
        bool, Opt("what earlier scans showed already is no evidence between the believed place and its rivals")
    ] = True
    map_changes: Annotated[
        bool,
        Opt("what a trusted place has found gone from the map is no new evidence; no bound where much of it is"),
    ] = True
    evidence_top: Annotated[
        float, Opt("what one scan may say between the believed place and its rivals, at the most", "nat", 0.1, 1e6)
    ] = 5.0
    match_samples: Annotated[
        int, Opt("particles drawn around the optimum of a scan match, by importance; 0 matches none", "", 0, 100_000)
    ] = 0
    match_slip: Annotated[float, Opt("probability that the odometry has slipped between updates", "", 1e-9, 0.5)] = 1e-3
    resampler: PlainResampler = "systematic"
    resample_threshold: Annotated[float, Opt("resample when N_eff falls below this share", "", 0, 1)] = 0.5
    beams_table: Annotated[bool, Opt("keep p(unknown) of every beam in beams.parquet")] = False
    motion_xy_per_m: XyPerM = 0.1
    motion_xy_per_rad_m: XyPerRad = 0.02
    motion_xy_m: XyOfAnyStep = 0.005
    motion_yaw_per_rad: YawPerRad = 0.1
    motion_yaw_per_m_rad: YawPerM = 0.05
    motion_yaw_rad: YawOfAnyStep = 0.003
