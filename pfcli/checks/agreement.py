"""Whether two sources say the same of a turn, and by which factor they differ where they do not."""

import math

import numpy as np
from numpy.typing import NDArray

TURNING_RAD = math.radians(2.0)
FEWEST = 6
DEGREES = 180.0 / math.pi


def wrapped(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles in -pi .. pi."""
    found: NDArray[np.float64] = np.remainder(angle + np.pi, 2 * np.pi) - np.pi
    return found


def agreeing(found: NDArray[np.float64], told: NDArray[np.float64], factor: float) -> float:
    """Share of turns (n,) that are `factor` times what was told; whole turns do not count."""
    tolerance = np.maximum(math.radians(1.5), 0.2 * np.abs(told)) * max(1.0, abs(factor) / 4)
    return float((np.abs(wrapped(found - factor * told)) < np.minimum(tolerance, 0.6)).mean())


def factor_of(found: NDArray[np.float64], told: NDArray[np.float64]) -> float | None:
    """By which factor `found` differs from what was told: 1 where they agree, -1 mirrored, 57.3 degrees for radians, 0 where
    it does not turn, another where the median has one; NaN where they have nothing to do with each other; None where too
    little turns to say."""
    turning = np.maximum(np.abs(found), np.abs(told)) > TURNING_RAD
    if turning.sum() < FEWEST:
        return None
    a, b = found[turning], told[turning]
    shares = {f: agreeing(a, b, f) for f in (1.0, -1.0, 0.0, DEGREES, -DEGREES)}
    if shares[1.0] >= 0.4:
        return 1.0
    inverse = {1 / f: agreeing(b, a, f) for f in (DEGREES, -DEGREES)}
    best = max(shares | inverse, key=lambda f: (shares | inverse)[f])
    if (shares | inverse)[best] >= 0.6:
        return best
    turned = np.abs(b) > TURNING_RAD
    if turned.sum() >= FEWEST:
        ratio = float(np.median(a[turned] / b[turned]))
        if 0.75 < ratio < 1.35:
            return 1.0
        if agreeing(a[turned], b[turned], ratio) >= 0.6:
            return ratio
    return math.nan
