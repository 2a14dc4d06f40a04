"""Which detections of a sighting count, how certain each is, and of which landmark."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.dropped import Dropped
from pfcli.errors import printable
from pfcli.events import Sighting
from pfcli.systems.slam_landmarks.observation_kernels import UNKNOWN
from pfcli.systems.slam_landmarks.params import Params

_STRANGE = "detections of landmarks that the map does not know"


class View(NamedTuple):
    """z (m, 2) range and bearing, variances (m, 2), known columns (m,) or UNKNOWN."""

    z: NDArray[np.float64]
    noise: NDArray[np.float64]
    column: NDArray[np.int32]

    @property
    def points_m(self) -> NDArray[np.float64]:
        """(m, 2) in the base frame."""
        ranges, bearings = self.z.T
        return np.asarray(ranges[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)]))

    @property
    def spread_m(self) -> NDArray[np.float64]:
        """(m,) of the points."""
        return np.asarray(np.sqrt(self.noise[:, 0] + self.z[:, 0] ** 2 * self.noise[:, 1]))


def of_sighting(
    sighting: Sighting, names: dict[str, int], mapped: bool, params: Params, dropped: Dropped
) -> tuple[View, dict[str, int]]:
    """Detections within range, each id once in an observation, and the columns of all ids: new ones get one, unless the
    landmarks are `mapped`. What is left out is counted in dropped."""
    names, rows, seen = dict(names), [], set[str]()
    bearing_sd = math.radians(params.bearing_sigma_deg)
    for group in sighting.landmarks:
        for name, r, bearing, sigma in zip(group.ids, group.range_m, group.bearing_rad, group.sigma, strict=True):
            if r > params.landmark_range_m:
                continue
            if name and name in seen and params.association != "unknown":
                note = f"landmark {printable(name)!r} is detected twice at one stamp; its first detection counts"
                dropped.add("landmark twice at a stamp", note)
                continue
            spread = math.hypot(params.range_sigma_m, params.range_sigma_share * r), bearing_sd
            sd = [s if math.isfinite(s) and s > 0.0 else d for s, d in zip(sigma, spread, strict=True)]
            rows.append((name, r, bearing, sd[0] ** 2, sd[1] ** 2))
            seen.add(name)
    known = params.association == "known" or (params.association == "auto" and all(name for name, *_ in rows))
    if known:
        rows = [row for row in rows if row[0]]
        if mapped:
            here = [row for row in rows if row[0] in names]
            if len(here) < len(rows):
                dropped.read[_STRANGE] += len(rows) - len(here)
            rows = here
        for name, *_ in rows:
            names.setdefault(name, len(names))
    numbers = np.array([row[1:] for row in rows], float).reshape(-1, 4)
    column = np.array([names[row[0]] if known else UNKNOWN for row in rows], np.int32)
    return View(numbers[:, :2].copy(), numbers[:, 2:].copy(), column), names
