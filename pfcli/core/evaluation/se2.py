"""Poses in the plane as rows, composed and related in plain numpy: what judges a run shares no kernel with it."""

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]


def wrap(angle: _Array) -> _Array:
    """Angles (..,) rad in -pi .. pi."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def compose(a: _Array, b: _Array) -> _Array:
    """Pose rows b (.., 3) in the frames of a (.., 3)."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x, y = b[..., 0], b[..., 1]
    return np.stack([a[..., 0] + c * x - s * y, a[..., 1] + s * x + c * y, wrap(a[..., 2] + b[..., 2])], -1)


def between(a: _Array, b: _Array) -> _Array:
    """Pose rows b (.., 3) seen from a (.., 3), m and rad."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return np.stack([c * dx + s * dy, -s * dx + c * dy, wrap(b[..., 2] - a[..., 2])], -1)
