"""Electronic compass: headings from field components, how well a heading fits, and the bias that iron leaves."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import wrap
from pfcli.core.jit import kernel


def heading(x_t: float, y_t: float) -> float:
    """Heading (rad, counter-clockwise from east) of a robot whose compass reads the field (x_t, y_t): x ahead, y to the left.

    Zhang 2011, section 2.3: Hx = H0 cos psi, Hy = -H0 sin psi with psi clockwise from north, in a frame whose y axis
    points right; there psi = atan2(-Hy, Hx). The printed arctan(Hx / Hy) is off by 90 degrees and knows half a turn only.
    """
    psi = math.atan2(y_t, x_t)
    return math.remainder(math.pi / 2 - psi, 2 * math.pi)


class Compass(NamedTuple):
    """sigma_rad: spread of a reading; share of readings that iron bends anyhow (they say nothing)."""

    sigma_rad: float
    outliers: float


@kernel
def log_likelihood(yaw, reading, sigma, outliers, out):
    """Log of the mixture (1 - outliers) N(reading - yaw; sigma) + outliers / 2 pi for each heading yaw (n,), into out (n,)."""
    peak = (1.0 - outliers) / (sigma * np.sqrt(2.0 * np.pi))
    for i in range(yaw.size):
        e = wrap(reading - yaw[i]) / sigma
        out[i] = np.log(peak * np.exp(-0.5 * e * e) + outliers / (2.0 * np.pi))


def fit(yaw_rad: NDArray[np.float64], reading_rad: float, model: Compass) -> NDArray[np.float64]:
    """Log likelihood (n,) of a reading for each heading (n,). The paper has no such model: see its PAPER.md."""
    out = np.empty(yaw_rad.size)
    log_likelihood(np.ascontiguousarray(yaw_rad), reading_rad, model.sigma_rad, model.outliers, out)
    return out


class Bias(NamedTuple):
    """What the compass reads too much (rad), and its variance."""

    mean_rad: float = 0.0
    variance: float = math.radians(10.0) ** 2


_DRIFT_PER_S = math.radians(0.5) ** 2
_GATE = 3.0


def is_bent(bias: Bias, residual_rad: float, sigma_rad: float) -> bool:
    """Whether a reading lies beyond three standard deviations of the learnt bias and its own."""
    return abs(residual_rad) > _GATE * math.sqrt(bias.variance + sigma_rad**2)


def learn(bias: Bias, residual_rad: float, sigma_rad: float, seconds: float, memory_s: float) -> Bias:
    """The bias after a reading that differs from the filter's heading by residual_rad + mean.

    A scalar Kalman filter; readings of one `memory_s` count as one, since iron bends them alike. Beyond three standard
    deviations nothing is learnt.
    """
    variance = bias.variance + _DRIFT_PER_S * seconds
    if is_bent(Bias(bias.mean_rad, variance), residual_rad, sigma_rad):
        return Bias(bias.mean_rad, variance)
    noise = sigma_rad**2 * max(1.0, memory_s / max(seconds, 1e-3))
    gain = variance / (variance + noise)
    return Bias(bias.mean_rad + gain * residual_rad, (1.0 - gain) * variance)
