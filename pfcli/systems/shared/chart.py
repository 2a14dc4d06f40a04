"""What a system wants drawn over time: the charts of its report."""

from typing import Any, NamedTuple

DEGREES = 57.29577951308232
"""Degrees in a radian."""


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


def one(title: str, column: str, unit: str = "", **more: Any) -> Chart:
    """A chart of one column, under the chart's own title."""
    return Chart(title, (Series(title, column),), unit, **more)


N_EFF = Chart("N_eff", (Series("N_eff", "n_eff"),), low=0.0)
RESAMPLED = one("resampled", "resampled", kind="bars", low=0.0, high=1.0)
ANCESTORS = one("unique ancestors", "unique_ancestors", low=0.0)
MODE = one("share of the reported mode", "mode_share", low=0.0, high=1.0)
SPREAD = one("standard deviation", "sd_m", "m", low=0.0)
