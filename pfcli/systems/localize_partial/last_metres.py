"""What the scans of the last metres foretell of the next one: the map has to do better."""

import numpy as np
from numpy.typing import NDArray

from pfcli.core.grid import rolling_grid
from pfcli.core.sensor import likelihood_field
from pfcli.systems.localize_partial.incomplete_map import model_of
from pfcli.systems.localize_partial.params import Params

_NOVEL = 0.5
"""Share of a mismatch that is forgiven a beam which ends where nothing was ever hit before."""


def explained(
    local: rolling_grid.LocalHistory,
    pose: NDArray[np.float64],
    way_m: float,
    ends: NDArray[np.float32],
    level: NDArray[np.int32],
    params: Params,
) -> NDArray[np.float32]:
    """(2, b) evidence that the last metres give to each beam.

    local: what they showed; pose: (3,) reckoned, in its frame; ends: (2, b) end points in the base frame; level: (b,) of the
    field for each.
    """
    if not params.outside_likelihood or params.history_m == 0.0:
        return np.zeros((2, ends.shape[1]), np.float32)
    away = rolling_grid.explained_m(local, pose, ends, way_m, params.history_m)
    base = np.maximum(0.0, likelihood_field.log_ratio(away, model_of(params), level) - params.history_margin)
    # not seen often enough: a passer-by or the first sight of a wall; half an argument against the map, then none
    passing = base[1] == 0.0
    base[1, passing] = np.log(1.0 - params.z_hit) * np.where(base[0, passing] > 0.0, 1.0, _NOVEL)
    return base.astype(np.float32)
