"""Where a localiser starts looking: `--initial` and `--heading-prior`."""

import math
from pathlib import Path
from typing import NamedTuple

from pfcli.errors import UsageError

KINDS = ("unknown", "inside", "outside", "pose", "region")
_SD = (0.25, 0.25, 0.1)


class Initial(NamedTuple):
    """kind: `unknown` (in the map or not), `inside` (anywhere in the map), `outside`, `pose` or `region`.

    pose, sd: mean and standard deviations (m, m, rad) of a pose; region: map YAML whose free cells are the region;
    heading: mean and standard deviation of the heading (rad), or None.
    """

    kind: str = "unknown"
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sd: tuple[float, float, float] = _SD
    region: Path | None = None
    heading: tuple[float, float] | None = None


def parse(text: str, heading: str | None = None) -> Initial:
    """From the words of the command line. Raises UsageError naming the flag."""
    prior: tuple[float, float] | None = None
    if heading is not None:
        given = _numbers("--heading-prior", heading, (1, 2), "YAW[,SD] in rad")
        prior = (given[0], given[1] if len(given) > 1 else 0.2)
        if prior[1] <= 0.0:
            raise UsageError(f"--heading-prior {heading}: the standard deviation must be positive")
    if text in ("unknown", "inside", "outside"):
        return Initial(text, heading=prior)
    if text.startswith("region:"):
        return Initial("region", region=Path(text[7:]), heading=prior)
    values = _numbers(
        "--initial", text, (3, 4, 5, 6), "unknown, inside, outside, region:MAP.yaml or X,Y,YAW[,SDX,SDY,SDYAW]"
    )
    if prior is not None:
        raise UsageError("--heading-prior: the pose of --initial has a heading already; leave one out")
    sd = (*values[3:], *_SD[len(values) - 3 :])
    if min(sd) < 0:
        raise UsageError(f"--initial {text}: standard deviations are negative")
    return Initial("pose", (values[0], values[1], values[2]), (sd[0], sd[1], sd[2]))


def _numbers(flag: str, text: str, counts: tuple[int, ...], expected: str) -> tuple[float, ...]:
    try:
        values = tuple(float(v) for v in text.split(","))
    except ValueError:
        raise UsageError(f"{flag} {text}: expected {expected}") from None
    if len(values) not in counts or not all(map(math.isfinite, values)):
        raise UsageError(f"{flag} {text}: expected {expected}")
    return values
