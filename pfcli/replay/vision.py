"""What vision saw, brought into metres and the robot's frame."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import compose
from pfcli.dropped import Loss
from pfcli.errors import UsageError
from pfcli.events import Landmarks, LinePoints, Pose2

RANGES = ("distance", "depth")
"""What a landmark's range is: how far away it is, or how far ahead, as a camera's lens measures it by the size in the image."""

_WIDEST_RAD = 1.4
"""Beyond this bearing nothing has a depth that tells a distance."""


class Image(NamedTuple):
    """What turns pixels of an omnidirectional camera into metres (Zhang 2011, eq. (5)): scale (pixels per cm) and centre
    (pixels); up in the image is ahead."""

    px_per_cm: float
    centre_px: tuple[float, float]

    def metres(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (n, 2) of the image (right, down) in the robot's frame (ahead, left)."""
        ahead = self.centre_px[1] - points_px[:, 1]
        left = self.centre_px[0] - points_px[:, 0]
        return np.column_stack([ahead, left]) / (100.0 * self.px_per_cm)


def distances(event: Landmarks, where: str, loss: Loss) -> Landmarks:
    """Landmarks whose ranges were depths along the sensor's axis; what is too far aside is left out. where: for messages."""
    ahead = np.abs(event.bearing_rad) < _WIDEST_RAD
    if not ahead.all():
        loss.add("depth aside", f"{where}: a depth at a bearing of more than {_WIDEST_RAD} rad tells no distance")
    return event._replace(
        ids=tuple(name for name, good in zip(event.ids, ahead.tolist(), strict=False) if good),
        range_m=event.range_m[ahead] / np.cos(event.bearing_rad[ahead]),
        bearing_rad=event.bearing_rad[ahead],
        sigma=event.sigma[ahead],
    )


def placed(
    event: LinePoints | Landmarks, mount: Pose2, image: Image | None, where: str, loss: Loss
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
        loss.add("point that is not a number", f"{where}: {what} are left out")
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
