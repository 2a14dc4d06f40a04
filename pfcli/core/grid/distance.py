"""Distances on a grid (scipy's exact Euclidean transform)."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage


def distance_m(cells: NDArray[np.bool_], resolution_m: float) -> NDArray[np.float64]:
    """Distance (m) of every cell's centre to the centre of the nearest marked cell; infinite where none is marked.

    cells: bool (rows, cols).
    """
    if not cells.any():
        return np.full(cells.shape, np.inf)
    found: NDArray[np.float64] = ndimage.distance_transform_edt(~cells) * resolution_m
    return found
