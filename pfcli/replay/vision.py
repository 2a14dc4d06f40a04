"""What vision saw, brought into metres and the robot's frame."""

import numpy as np

from pfcli.core.geometry import compose
from pfcli.dropped import Dropped
from pfcli.errors import UsageError
from pfcli.events import Landmarks, LinePoints, Pose2
from pfcli.replay.settings import Image

_WIDEST_RAD = 1.4
"""Beyond this bearing nothing has a depth that tells a distance."""


def distances(event: Landmarks, where: str, dropped: Dropped) -> Landmarks:
    """Landmarks whose ranges were depths along the sensor's axis; what is too far aside is left out. where: for messages."""
    ahead = np.abs(event.bearing_rad) < _WIDEST_RAD
    if not ahead.all():
        dropped.add("depth aside", f"{where}: a depth at a bearing of more than {_WIDEST_RAD} rad tells no distance")
    return event._replace(
        ids=tuple(name for name, good in zip(event.ids, ahead.tolist(), strict=False) if good),
        range_m=event.range_m[ahead] / np.cos(event.bearing_rad[ahead]),
        bearing_rad=event.bearing_rad[ahead],
        sigma=event.sigma[ahead],
    )


def placed(
    event: LinePoints | Landmarks, mount: Pose2, image: Image | None, where: str, dropped: Dropped
) -> LinePoints | Landmarks:
    """The event in metres and in the base frame; what is not a number is left out. Raises UsageError for pixels without an
    image. where: file and topic, for messages."""
    if isinstance(event, LinePoints):
        points = event.points_m
    else:
        c, s = np.cos(event.bearing_rad), np.sin(event.bearing_rad)
        points = event.range_m[:, None] * np.column_stack([c, s])
        points = np.where((event.range_m > 0.0)[:, None], points, np.nan)
    if event.pixels:
        if image is None:
            raise UsageError(f"{where} holds pixels; say what a pixel is with --px-per-cm and --image-centre")
        points = image.metres(points)
    known = np.asarray(np.isfinite(points).all(axis=1))
    if not known.all():
        what = (
            "points that are not numbers"
            if isinstance(event, LinePoints)
            else "landmarks without a range (> 0) or bearing"
        )
        dropped.add("point that is not a number", f"{where}: {what} are left out")
        points = points[known]
    if points.size and any(mount):
        points = compose(np.array([mount]), np.column_stack([points, np.zeros(len(points))]))[:, :2]
    if isinstance(event, LinePoints):
        return LinePoints(event.stamp_ns, points)
    return Landmarks(
        event.stamp_ns,
        tuple(name for name, good in zip(event.ids, known.tolist(), strict=False) if good),
        np.hypot(points[:, 0], points[:, 1]),
        np.arctan2(points[:, 1], points[:, 0]),
        event.sigma[known],
    )
