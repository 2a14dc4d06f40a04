"""Parameters of `localize-lookup`."""

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
    """Defaults hold for indoor robots; `--variant paper` takes what the paper prints and leaves the rest alone."""

    variant: Annotated[
        str,
        Opt(
            "paper: best heading, Gaussian, multinomial every time, best particle; corrected: headings drawn and narrowed"
            " down, hits beside obstacles, --resampler when N_eff is low, densest hypothesis",
            choices=("corrected", "paper"),
        ),
    ] = "corrected"
    particles: Annotated[int, Opt("particles", "", 1, 1_000_000)] = 3500
    start_density_per_m2: Annotated[
        float,
        Opt("places tried at an unknown start, per free area, if that is more than the particles", "1/m^2", 0, 1e5),
    ] = 50.0
    headings: Annotated[
        str, Opt("of the first particles: matched to the reading, or random", choices=("match", "random"))
    ] = "match"
    modes: Annotated[
        int,
        Opt(
            "modes of the heading at each place from which one is drawn, beside one from the rest (corrected)",
            "",
            1,
            36,
        ),
    ] = 3
    ranges: Annotated[str, Opt("expected ranges: looked up, or rays cast each time", choices=("table", "rays"))] = (
        "table"
    )
    bins: Annotated[int, Opt("directions per turn in the table", "", 72, 720)] = 360
    table_range_m: Annotated[float, Opt("longest ray in the table", "m", 0.1, 1000)] = 30.0
    table_budget_mib: Annotated[
        float, Opt("a table that would take more is not built: rays are cast instead", "MiB", 0, 1e6)
    ] = 2048.0
    veil_m: Annotated[
        float,
        Opt(
            "unknown cells so near to a wall, or in gaps of the map no wider than twice that, are looked through",
            "m",
            0,
            10,
        ),
    ] = 0.3
    update_distance_m: Annotated[float, Opt("a reading updates the filter after this way", "m", 0, 100)] = 0.1
    update_angle_rad: Annotated[float, Opt("or after this turn", "rad", 0, 10)] = 0.1
    beams: Annotated[int, Opt("beams of a scan that are used", "", 1, 100_000)] = 60
    max_range_m: Annotated[float, Opt("use beams up to this range; 0 takes the messages' range_max", "m", 0, 1000)] = (
        0.0
    )
    no_return: Annotated[bool, Opt("beams that bring nothing back count as well")] = False
    sigma_hit_m: Annotated[float, Opt("spread of readings around the expected range", "m", 1e-3, 10)] = 0.1
    z_hit: Annotated[float, Opt("share of beams that end at mapped surfaces (corrected)", "", 0.01, 0.999)] = 0.5
    z_short: Annotated[float, Opt("share that stops at something nearer (corrected)", "", 0, 0.99)] = 0.2
    z_none: Annotated[float, Opt("share that brings nothing back (corrected)", "", 0, 0.99)] = 0.05
    reach_m: Annotated[float, Opt("how far a beam reads in an unknown place (corrected)", "m", 0.1, 1000)] = 5.0
    independent_beams: Annotated[
        float, Opt("how many independent beams a scan is worth at the most (corrected)", "", 0.1, 1e4)
    ] = 12.0
    resampler: CorrectedResampler = "systematic"
    resample_threshold: Annotated[float, Opt("resample when N_eff falls below this share (corrected)", "", 0, 1)] = 0.5
    lost_share: Annotated[
        float,
        Opt(
            "who seems lost may be anywhere with this probability: the whole map is looked at again (corrected); 0: never",
            "",
            0,
            0.99,
        ),
    ] = 0.01
    lost_fit: Annotated[
        float,
        Opt("lost is who sees less than this share of the best evidence a reading can give (corrected)", "", -1, 1),
    ] = 0.25
    motion_xy_per_m: XyPerM = 0.1
    motion_xy_per_rad_m: XyPerRad = 0.02
    motion_xy_m: XyOfAnyStep = 0.005
    motion_yaw_per_rad: YawPerRad = 0.1
    motion_yaw_per_m_rad: YawPerM = 0.05
    motion_yaw_rad: YawOfAnyStep = 0.003
