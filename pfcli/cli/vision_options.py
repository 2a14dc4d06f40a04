"""Command-line options that say what vision measured."""

import math
from collections.abc import Callable
from typing import Any

import click

from pfcli.cli.types import Finite
from pfcli.errors import UsageError
from pfcli.replay.settings import RANGES, Image


def image_of(px_per_cm: float | None, centre: str | None) -> Image | None:
    """The image of `--px-per-cm` and `--image-centre`, if they are given. Raises UsageError."""
    if px_per_cm is None and centre is None:
        return None
    try:
        x, y = (float(v) for v in (centre or "").split(","))
    except ValueError:
        raise UsageError("--px-per-cm and --image-centre X,Y (pixels) belong together") from None
    if px_per_cm is None or not math.isfinite(x + y):
        raise UsageError("--px-per-cm and --image-centre X,Y (pixels) belong together")
    return Image(px_per_cm, (x, y))


def vision_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options of every command that may read what vision saw."""
    for option in reversed(
        (
            click.option(
                "--px-per-cm",
                type=Finite(0, 1e4, min_open=True),
                default=None,
                help="Vision in pixels: its scale (0.286).",
            ),
            click.option(
                "--image-centre", metavar="X,Y", default=None, help="Vision in pixels: where the robot is in it."
            ),
            click.option(
                "--landmark-ranges",
                type=click.Choice(RANGES),
                default=RANGES[0],
                show_default=True,
                help="What ranges of landmarks are: the distance, or the depth along the camera's axis.",
            ),
        )
    ):
        command = option(command)
    return command
