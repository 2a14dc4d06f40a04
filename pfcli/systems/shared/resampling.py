"""When and how the filters resample: as printed, or by the named resampler; GDR disperses the offspring."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core.resample import csw, gdr, multinomial
from pfcli.errors import UsageError
from pfcli.registry import resampler
from pfcli.rng import Draw, Purpose


def chosen(
    weights: NDArray[np.float64], n_eff: float, params: Any, draw: Draw, stamp_ns: int
) -> NDArray[np.int64] | None:
    """Parent of each of `particles` offspring; None while weights (n,) are even enough and the particles not too many.

    As printed (`--variant paper`) every time, multinomial; else by the named resampler. params: with `variant`, `particles`,
    `resampler` and `resample_threshold`.
    """
    if params.variant == "paper":
        rng = draw(Purpose.RESAMPLE, stamp_ns)
        return np.asarray(multinomial.ancestors(weights, rng.random(params.particles)))
    if weights.size <= params.particles and n_eff >= params.resample_threshold * weights.size:
        return None
    return by_name(params.resampler, weights, params.particles, draw(Purpose.RESAMPLE, stamp_ns))


def ancestors_of(weights: NDArray[np.float64], params: Any, draw: Draw, stamp_ns: int) -> NDArray[np.int64]:
    """Parent (n,) of each offspring. params: with `resampler` and `sort`."""
    rng = draw(Purpose.RESAMPLE, stamp_ns)
    if params.resampler in ("gdr", "csw"):
        return csw.ancestors(weights, rng.random(1), params.sort)
    return by_name(params.resampler, weights, weights.size, rng)


def by_name(name: str, weights: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Parent (count,) of each offspring, by the resampler of this name. Raises UsageError where it gives anything else."""
    found = np.asarray(resampler(name)(weights, count, rng))
    if found.shape != (count,) or found.dtype != np.int64 or found.min() < 0 or found.max() >= weights.size:
        raise UsageError(
            f"resampler {name!r} gave {found.dtype} {found.shape}; it must give int64 ({count},), each from 0 to"
            f" {weights.size - 1}"
        )
    return found


def dispersed(
    pose: NDArray[np.float64],
    ancestors: NDArray[np.int64],
    weights: NDArray[np.float64],
    params: Any,
    draw: Draw,
    stamp_ns: int,
) -> NDArray[np.float64]:
    """Poses (n, 3) of the offspring; GDR disperses them around their parents (Zhang 2016, eqs (7)-(8)).

    params: with `resampler`, `variant`, `alpha_xy_m`, `alpha_yaw_deg`, `dispersal_cap` and `disperse_first`.
    """
    out = pose[ancestors]
    if params.resampler != "gdr":
        return out
    n, paper = pose.shape[0], params.variant == "paper"
    factor = gdr.scales(weights[ancestors], 1 if paper else n, np.inf if paper else params.dispersal_cap)
    sigma = np.array([params.alpha_xy_m, params.alpha_xy_m, np.radians(params.alpha_yaw_deg)])
    z = draw(Purpose.DISPERSE, stamp_ns).standard_normal((n, 3))
    return np.asarray(gdr.disperse(out, ancestors, factor, sigma, not (paper or params.disperse_first), z))
