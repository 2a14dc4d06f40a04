"""When and how the filters resample: systematic or as printed, or by the named resampler with dispersed offspring."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.core.resample import csw, gdr, multinomial, stratified, systematic
from pfcli.rng import Draw, Purpose


def chosen(
    weights: NDArray[np.float64], n_eff: float, params: Any, draw: Draw, stamp_ns: int
) -> NDArray[np.int64] | None:
    """Parent of each of `particles` offspring; None while weights (n,) are even enough and the particles not too many.

    As printed (`--variant paper`) every time, multinomial; else systematic. params: with `variant`, `particles` and
    `resample_threshold`.
    """
    if params.variant == "paper":
        rng = draw(Purpose.RESAMPLE, stamp_ns)
        return np.asarray(multinomial.ancestors(weights, rng.random(params.particles)))
    if weights.size <= params.particles and n_eff >= params.resample_threshold * weights.size:
        return None
    rng = draw(Purpose.RESAMPLE, stamp_ns)
    return np.asarray(systematic.choose(weights, rng.random(), params.particles))


def ancestors_of(weights: NDArray[np.float64], params: Any, draw: Draw, stamp_ns: int) -> NDArray[np.int64]:
    """Parent (n,) of each offspring. params: with `resampler` and `sort`."""
    rng = draw(Purpose.RESAMPLE, stamp_ns)
    if params.resampler == "stratified":
        return np.asarray(stratified.ancestors(weights, rng.random(weights.size)))
    if params.resampler == "systematic":
        return np.asarray(systematic.ancestors(weights, rng.random(1)))
    return csw.ancestors(weights, rng.random(1), params.sort)


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
