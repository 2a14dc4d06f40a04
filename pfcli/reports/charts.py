"""What matters over time in each system: the charts of a report."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np


class Series(NamedTuple):
    """A column under the name that people read; factor: what it is multiplied by; thin: a bound or a reference."""

    name: str
    column: str
    factor: float = 1.0
    thin: bool = False


class Chart(NamedTuple):
    """Columns of `metrics.parquet` (or `track.parquet`) over time; kind: line, stack (shares of one), bars."""

    title: str
    series: tuple[Series, ...]
    unit: str = ""
    kind: str = "line"
    low: float | None = None
    high: float | None = None
    table: str = "metrics"


_DEGREES = 180.0 / np.pi


def _one(title: str, column: str, unit: str = "", **more: Any) -> Chart:
    return Chart(title, (Series(title, column),), unit, **more)


_N_EFF = Chart("N_eff", (Series("N_eff", "n_eff"),), low=0.0)
_RESAMPLED = _one("resampled", "resampled", kind="bars", low=0.0, high=1.0)
_ANCESTORS = _one("unique ancestors", "unique_ancestors", low=0.0)
_MODE = _one("share of the reported mode", "mode_share", low=0.0, high=1.0)
_SPREAD = _one("standard deviation", "sd_m", "m", low=0.0)

ERRORS = (
    Chart(
        "error against truth",
        (Series("position", "error_m"), Series("two standard deviations", "bound_m", thin=True)),
        "m",
        low=0.0,
        table="track",
    ),
    Chart("heading error", (Series("heading", "error_yaw_rad", _DEGREES),), "deg", table="track"),
)
"""Of every system whose run had a truth."""

CHARTS: dict[str, tuple[Chart, ...]] = {
    "localize-partial": (
        Chart("probability of the states", tuple(Series(f"B{k}", f"b{k}") for k in range(1, 7)), kind="stack"),
        Chart(
            "in the map",
            (Series("filter", "in_map"), Series("smoothed", "in_map_smoothed", thin=True)),
            low=0.0,
            high=1.0,
        ),
        Chart("particles of the clusters", tuple(Series(f"C{k}", f"n{k}") for k in range(2, 7)), low=0.0),
        _N_EFF,
        _SPREAD,
    ),
    "localize-reliable": (
        _one("p(success)", "p_success", low=0.0, high=1.0),
        Chart(
            "protection level",
            (Series("protection", "protection_m"), Series("deviation", "sd_m", thin=True)),
            "m",
            low=0.0,
        ),
        Chart(
            "share of the beams",
            (Series("unknown", "unknown_share"), Series("misaligned", "misaligned")),
            low=0.0,
            high=1.0,
        ),
        Chart("global samples", (Series("drawn", "gl_drawn"),), kind="bars", low=0.0),
        Chart("weight that global samples won", (Series("weight", "gl_mass"),), low=0.0, high=1.0),
        _N_EFF,
    ),
    "localize-lookup": (
        _MODE,
        _one("modes", "modes", low=0.0),
        _SPREAD,
        _one("share of ranges outside the table", "missed", low=0.0),
        _N_EFF,
        _RESAMPLED,
    ),
    "fuse-soccer": (
        _one("probability of the other side", "mirror_p", low=0.0, high=1.0),
        Chart(
            "compass",
            (Series("residual", "compass_residual_rad", _DEGREES), Series("bias", "compass_bias_rad", _DEGREES)),
            "deg",
        ),
        Chart("seen", (Series("line points", "points"), Series("landmarks", "landmarks")), low=0.0),
        _SPREAD,
        _one("slip of the wheels", "slip_m", "m", low=0.0),
        _one("injected", "injected", kind="bars", low=0.0),
        _N_EFF,
    ),
    "slam-gdr": (
        _N_EFF,
        _RESAMPLED,
        _ANCESTORS,
        _one("share of beams that match the map", "match_inliers", low=0.0, high=1.0),
        Chart(
            "spread",
            (Series("particles", "particle_spread_m"), Series("offspring", "offspring_spread_m")),
            "m",
            low=0.0,
        ),
        _one("tiles of the maps", "tiles", low=0.0),
    ),
    "slam-gdr --landmarks": (
        _N_EFF,
        _RESAMPLED,
        _ANCESTORS,
        Chart("landmarks", (Series("in the map", "landmarks"), Series("detected", "detections")), low=0.0),
        _SPREAD,
        Chart("NEES", (Series("NEES", "nees"),), low=0.0, high=12.0, table="track"),
    ),
}

CLASSES = {
    "localize-partial": ("", "", "C2", "C3", "C4", "C5", "C6"),
    "localize-reliable": ("doubted", "trusted"),
}
"""Names of `particle_class` where a system has classes."""


def marks(summary: Mapping[str, Any], start_ns: int) -> list[tuple[float, str]]:
    """(seconds, text) of what happened once: entries and exits, recoveries, certainty."""
    found = [((c["t_ns"] - start_ns) * 1e-9, str(c["kind"])) for c in summary.get("crossings", [])]
    for row in summary.get("recoveries", []):
        found.append((row["lost_s"], f"lost, by {row['moved_m']:g} m"))
        found.append((row["lost_s"] + row["after_s"], "found again"))
    if summary.get("certain_since_s") is not None:
        found.append((summary["certain_since_s"], "certain"))
    return sorted(found)
