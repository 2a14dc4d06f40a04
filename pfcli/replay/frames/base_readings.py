"""Decoded messages as events in the base frame: each finds where its sensor sits, and is turned by what it is."""

import math
from typing import Any, NamedTuple

import numpy as np

from pfcli.dropped import Dropped
from pfcli.errors import LogError, UsageError, printable
from pfcli.events import Event, Heading, Landmarks, LinePoints, Odometry, Pose2, Range, Scan, Truth
from pfcli.formats.messages import polar
from pfcli.formats.raw_readings import Attitude, BodyPose, BodySpeed, Cloud, Gyroscope, Magnetometer, Spots
from pfcli.replay import vision
from pfcli.replay.frames import placing
from pfcli.replay.frames.robot_frames import Mount, RobotFrames, mount_of
from pfcli.replay.reorder import Source
from pfcli.replay.settings import Band, Image

_NOWHERE = mount_of(np.eye(4))
_UNPLACED = (Odometry, Truth)
"""What was asked for in the base frame when its decoder was chosen."""


class Setup(NamedTuple):
    """How readings become events: the image of vision, what landmarks' ranges are, and the heights that are walls."""

    image: Image | None
    landmark_ranges: str
    band: Band


class BaseReadings:
    """Readings in the base frame of one replay. It remembers what sits where, and where bodies began."""

    def __init__(self, frames: RobotFrames, setup: Setup, dropped: Dropped) -> None:
        self._frames, self._setup, self._dropped = frames, setup, dropped
        self._mounts: dict[tuple[str, str], Mount] = {}
        self._carried: dict[str, placing.Carried] = {}
        self._gravity: dict[str, placing.Gravity] = {}

    def __call__(self, source: Source, event: Any, frame: str) -> Event | None:
        """The event in the base frame, None where it says nothing. Raises LogError where the set-up does not say where the
        sensor sits, ValueError where the message is at fault."""
        if isinstance(event, _UNPLACED) or not hasattr(event, "_fields") or type(event) not in _PLACED:
            return event  # type: ignore[no-any-return]
        mount = self._mount(source, frame, event)
        if mount is None:
            return placing.upright(event, self._gravity.setdefault(source.channel.topic, placing.Gravity()))
        return self._placed(source, event, frame, mount)

    def _mount(self, source: Source, frame: str, event: Any) -> Mount | None:
        """Where the sensor sits; None for an IMU that nothing places but gravity. A frame that nobody knows is an error of the
        set-up, and one of the message where others of the topic had one that is known."""
        topic = source.channel.topic
        key = (topic, frame)
        found = self._mounts.get(key)
        if found is not None:
            return found
        if isinstance(event, BodySpeed | BodyPose) and self._frames.way_to_base(frame, topic) is None:
            self._mounts[key] = _NOWHERE
            if isinstance(event, BodySpeed):
                self._dropped.read["speeds of a frame that nothing places, taken for the base's"] += 1
            return _NOWHERE
        try:
            found, always = self._frames.mount(frame, topic, event.stamp_ns)
        except LogError:
            if any(known == topic for known, _ in self._mounts):
                raise ValueError(f"names the frame {frame!r}, which nothing else does") from None
            if isinstance(event, Gyroscope) and all(map(math.isfinite, event.acceleration_mps2)):
                self._dropped.read["turn rates levelled by gravity"] += 1
                return None
            raise
        if always:
            self._mounts[key] = found
        return found

    def _placed(self, source: Source, event: Any, frame: str, mount: Mount) -> Event | None:
        at = placing.Reading(source.where, source.channel.topic, frame, mount)
        if isinstance(event, Scan):
            return placing.scan(event, at, self._setup.band, self._dropped)
        if isinstance(event, Cloud):
            return placing.cloud(event, at, self._setup.band, self._dropped)
        if isinstance(event, Range):
            return placing.finder(event, at, self._dropped)
        if isinstance(event, Gyroscope):
            return placing.yaw_rate(event, mount)
        if isinstance(event, Attitude):
            return placing.heading(event, mount)
        if isinstance(event, Magnetometer):
            return placing.compass_heading(event, mount)
        if isinstance(event, BodySpeed):
            return placing.velocity(event, mount)
        if isinstance(event, BodyPose):
            if source.role == "truth":
                return placing.truth(event, mount)
            return self._carried.setdefault(source.channel.topic, placing.Carried())(event, mount)
        return self._seen(source, event, frame, mount)

    def _seen(self, source: Source, event: Any, frame: str, mount: Mount) -> Event:
        """What vision detected, or a compass that is a heading already: in the plane, or in space."""
        pose = mount.pose
        if isinstance(event, Spots):
            event, pose = placing.spots(event, mount, polar), Pose2()
        elif mount.flipped or mount.tilt_rad > _LEANS_RAD:
            raise UsageError(
                f"{source.where}: frame {printable(frame)!r} is not upright; give points on the ground in a frame whose z"
                " points up, or say --extrinsic base_link:FRAME=x,y,yaw"
            )
        if isinstance(event, Heading):
            return event._replace(yaw_rad=math.remainder(event.yaw_rad - pose.yaw_rad, 2 * math.pi))
        if isinstance(event, Landmarks) and self._setup.landmark_ranges == "depth":
            event = vision.distances(event, source.where, self._dropped)
        return vision.placed(event, pose, self._setup.image, source.where, self._dropped)


_LEANS_RAD = math.acos(0.99)
"""Points on the ground are given in a frame that leans less."""
_PLACED = (
    Scan, Cloud, Range, Gyroscope, Attitude, Magnetometer, BodySpeed, BodyPose, Spots, LinePoints, Landmarks, Heading
)  # fmt: skip
