"""Parameters of `localize-partial`."""

from dataclasses import dataclass
from typing import Annotated

from pfcli.params import Opt
from pfcli.systems.shared.shared_params import (
    CorrectedResampler,
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

    variant: Annotated[
        str,
        Opt(
            "paper: algorithm 1 as printed; corrected: likelihood counted once, evidence against the outside, entry by way",
            choices=("corrected", "paper"),
        ),
    ] = "corrected"
    particles: Annotated[int, Opt("most particles of a cluster", "", 1, 1_000_000)] = 50_000
    min_particles: Annotated[
        int, Opt("fewest particles of a cluster that holds mass, and candidates (corrected)", "", 1, 1_000_000)
    ] = 200
    start_density_per_m2: Annotated[
        float,
        Opt("blind poses at an unknown start, per free area (two million at the most)", "1/m^2", 0.1, 1e5),
    ] = 1000.0
    frontier_samples: Annotated[
        int,
        Opt(
            "fresh candidates at the frontiers per update (N2); corrected: at the most; three times as many are kept"
            " of an improbable inside",
            "",
            1,
            1_000_000,
        ),
    ] = 4000
    update_distance_m: Annotated[float, Opt("a scan updates the filter after this way", "m", 0, 100)] = 0.1
    update_angle_rad: Annotated[float, Opt("or after this turn", "rad", 0, 10)] = 0.1
    entry_length_m: Annotated[float, Opt("mean way outside before a robot enters (corrected)", "m", 0.01, 1e6)] = 20.0
    p12: Annotated[float, Opt("probability of a first entry per update (paper)", "", 0, 1)] = 0.1
    outside_likelihood: Annotated[bool, Opt("let the outside classes compete with the inside ones for the scan")] = True
    history_m: Annotated[
        float, Opt("way whose scans predict the next one; the map must do better. 0: never", "m", 0, 50)
    ] = 15.0
    history_margin: Annotated[float, Opt("how much worse than the map that prediction is taken to be", "", 0, 10)] = (
        0.25
    )
    kidnap_per_m: Annotated[
        float, Opt("share of the belief that may be anywhere else after a metre; 0 never", "1/m", 0, 1)
    ] = 0.001
    match_scans: Annotated[bool, Opt("match scans with those of the last metres: better odometry, wheels may slip")] = (
        True
    )
    model_unknown: Annotated[bool, Opt("beams that end in unknown cells say nothing")] = True
    kld: Annotated[bool, Opt("as many particles per cluster as its spread needs")] = True
    kld_error: Annotated[float, Opt("Kullback-Leibler distance that the particles may lose", "", 1e-3, 1)] = 0.01
    smooth: Annotated[
        bool, Opt("classes, entries, exits and poses as the whole log knows them, beside those at the time")
    ] = True
    extend_map: Annotated[
        bool, Opt("also write extended.pgm: the map, and beyond it what the robot saw (with --smooth)")
    ] = False
    robot_radius_m: Annotated[float, Opt("a robot of this radius must fit through a frontier", "m", 0, 10)] = 0.15
    pocket_m2: Annotated[float, Opt("unknown patches smaller than this belong to the inside", "m^2", 0, 1e6)] = 1.0
    beams: Annotated[int, Opt("beams of a scan that are used", "", 1, 100_000)] = 60
    max_range_m: Annotated[
        float,
        Opt("use beams up to this range: farther ones swing too wide; 0 takes the messages' range_max", "m", 0, 1000),
    ] = 10.0
    sigma_hit_m: Annotated[float, Opt("spread of end points around mapped surfaces", "m", 1e-3, 10)] = 0.1
    heading_sd_rad: Annotated[
        float, Opt("heading error that a particle is allowed: distant beams are blurred by it", "rad", 0, 1)
    ] = 0.02
    z_hit: Annotated[float, Opt("share of beams that end at mapped surfaces", "", 0.01, 0.999)] = 0.8
    reach_m: Annotated[float, Opt("how far a beam reads in an unknown place", "m", 0.1, 1000)] = 5.0
    beam_gain: Annotated[float, Opt("how many independent beams one beam is worth", "", 1e-4, 10)] = 0.07
    resampler: CorrectedResampler = "systematic"
    resample_threshold: Annotated[float, Opt("resample a cluster when N_eff falls below this share", "", 0, 1)] = 0.5
    motion_xy_per_m: XyPerM = 0.1
    motion_xy_per_rad_m: XyPerRad = 0.02
    motion_xy_m: XyOfAnyStep = 0.005
    motion_yaw_per_rad: YawPerRad = 0.1
    motion_yaw_per_m_rad: YawPerM = 0.05
    motion_yaw_rad: YawOfAnyStep = 0.003
