"""What matters over time in each system: the charts of a report."""

from collections.abc import Mapping
from typing import Any

from pfcli.systems.shared.chart import DEGREES, Chart, Series

ERRORS = (
    Chart(
        "error against truth",
        (Series("position", "error_m"), Series("two standard deviations", "bound_m", thin=True)),
        "m",
        low=0.0,
        table="track",
    ),
    Chart("heading error", (Series("heading", "error_yaw_rad", DEGREES),), "deg", table="track"),
)
"""Of every system whose run had a truth."""


def marks(summary: Mapping[str, Any], start_ns: int) -> list[tuple[float, str]]:
    """(seconds, text) of what happened once: entries and exits, recoveries, certainty."""
    found = [((c["t_ns"] - start_ns) * 1e-9, str(c["kind"])) for c in summary.get("crossings", [])]
    for row in summary.get("recoveries", []):
        found.append((row["lost_s"], f"lost, by {row['moved_m']:g} m"))
        found.append((row["lost_s"] + row["after_s"], "found again"))
    if summary.get("certain_since_s") is not None:
        found.append((summary["certain_since_s"], "certain"))
    return sorted(found)
