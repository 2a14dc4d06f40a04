"""Recordings as one time-ordered stream of events, as fast as the disk gives them and in bounded memory.

The order is total: (stamp, rank of the topic's role, sequence), made by a reorder buffer. Messages are decoded only
where a role of the run asks for their topic. What is lost on the way is counted, never silent.
"""

import math
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pfcli.dropped import Dropped
from pfcli.errors import LogError, UsageError, printable
from pfcli.events import Event, Heading, Landmarks, LinePoints, Odometry, Range, Scan, Truth
from pfcli.formats import json_messages
from pfcli.formats.extrinsics import Extrinsics, Mount, from_transform
from pfcli.formats.limits import Reading
from pfcli.formats.messages import SECOND, Decoder, Transform, decoder, transforms, yaw_of
from pfcli.formats.reader import Channel, Wanted
from pfcli.formats.recording import Recording
from pfcli.formats.roles import MANY, ROLES
from pfcli.replay import plausible, vision
from pfcli.replay.reorder import Reorder, Source, Stamp, Waiting
from pfcli.replay.settings import Settings

SOURCE_STAMP_TOPIC = "/source_stamp"
_TF = "tf2_msgs/msg/TFMessage"
_TRUTH_NAMES = ("truth", "ground_truth", "groundtruth", "mocap", "reference")
_MOUNTED = (Scan, Range, LinePoints, Landmarks, Heading)
_VISION = ("lines", "landmarks")
_PLACES = 10
"""So many damaged places of a log are named; the others are counted."""


DEFAULTS = Settings()


class Log:
    """An opened recording, of one part or more: its channels are known, its events can be replayed any number of times."""

    def __init__(self, paths: Path | Sequence[Path], settings: Settings = DEFAULTS) -> None:
        self.settings = settings
        self.dropped = Dropped()
        self._file = Recording([paths] if isinstance(paths, Path) else paths, Reading(settings.limits.chunk_mib))
        self.path = self._file.path
        self.damage = f" ({self._file.losses[0].partition(': ')[2]})" if self._file.losses else ""
        """What a survey that found damage says of it, for messages about what the log lacks."""
        self._extrinsics = self._read_extrinsics()

    @property
    def channels(self) -> list[Channel]:
        """The channels that the file declares."""
        return list(self._file.channels.values())

    def topics(self) -> dict[str, str]:
        """Topic -> message type, in the file's order."""
        return {c.topic: c.schema_name for c in self.channels}

    def roles(self) -> dict[str, list[str]]:
        """Role -> the topics that could play it, by message type, name and `--topic`."""
        found: dict[str, list[str]] = {}
        for role, types in ROLES.items():
            mapped = self.settings.topics.get(role)
            if mapped is not None:
                found[role] = mapped.split(",") if role in MANY else [mapped]
                continue
            for topic, schema in self.topics().items():
                if schema in types and _fits(role, topic, schema) and self._is_free(role, topic, schema):
                    found.setdefault(role, []).append(topic)
        return found

    def _is_free(self, role: str, topic: str, schema: str) -> bool:
        """Whether nobody gave this topic another role; one topic of vision may hold lines and landmarks. Pixels without a
        scale are no landmarks that anybody asked for."""
        if schema == "vision_msgs/msg/Detection2DArray" and self.settings.image is None:
            return False
        taken = {t for r, t in self.settings.topics.items() if not (role in _VISION and r in _VISION)}
        return topic not in taken

    def choose(self, role: str) -> str | None:
        """The topic of a role, or None where the log has none. Raises UsageError where there are several."""
        topics = self.roles().get(role, [])
        if len(topics) > 1 and role not in MANY:
            names = ", ".join(printable(t) for t in topics)
            raise UsageError(
                f"{self.path}: several topics can be the {role}: {names}; choose with --topic {role}=TOPIC"
            )
        return topics[0] if topics else None

    def _read_extrinsics(self) -> Extrinsics:
        found = Extrinsics()
        static = {c.id for c in self.channels if c.schema_name == _TF and c.topic.endswith("tf_static")}
        if static:
            for batch in self._file.batches(Wanted(frozenset(static))):
                for k in np.flatnonzero(np.isin(batch.channel, list(static))).tolist():
                    for t in transforms(batch.data, int(batch.offset[k]), int(batch.length[k])):
                        found.add(t.parent, t.child, from_transform(t.translation, t.rotation))
        found.add_flags(self.settings.extrinsics)
        return found

    def events(self, roles: Sequence[str]) -> Iterator[Event]:
        """Events of the topics that play `roles`, in the total order."""
        sources = [s for role in roles for s in self._sources(role)]
        self.dropped = Dropped()
        mounts: dict[str, Mount] = {}
        reading = self.settings
        offsets = {role: int(s * SECOND) for role, s in reading.offsets_s.items()}
        room = int(reading.limits.buffer_mib * 2**20)
        waiting = Waiting(int(reading.reorder_s * SECOND), room, reading.clock, offsets)
        order = Reorder(self.path, sources, waiting, (reading.start_s, reading.end_s), self.dropped)
        for source, buffer, offset, length, stamp_ns in order.messages(self._file.batches(_wanted(sources))):
            event = self._decoded(source, buffer, offset, length, stamp_ns, mounts)
            if event is not None:
                yield event
        for note in self._file.losses:
            self.dropped.add("damaged place", note, _PLACES)
        self.dropped.notes += self._file.notes
        if self._file.missing:
            self.dropped.counts["missing message"] += self._file.missing

    def _sources(self, role: str) -> list[Source]:
        topics = self.roles().get(role, []) if role in MANY else [self.choose(role)]
        sources = []
        for topic in topics:
            if topic is None:
                continue
            name, _, frames = topic.partition(":") if topic.lstrip("/").startswith("tf:") else (topic, "", "")
            name = "/tf" if frames else name
            channels = [c for c in self.channels if c.topic == name]
            if not channels:
                have = ", ".join(printable(t) for t in self.topics()) or "none"
                raise UsageError(f"{self.path}: --topic {role}={topic}: no such topic; the log has {have}{self.damage}")
            sources += [self._source(role, topic, frames, _with_schema(role, c)) for c in channels]
        return sources

    def _source(self, role: str, topic: str, frames: str, channel: Channel) -> Source:
        """Raises UsageError where the role cannot be played by the channel's type or encoding."""
        where, schema = f"{self.path}: topic {printable(topic)!r}", channel.schema_name
        if not frames and schema not in ROLES[role]:
            legal = ", ".join(ROLES[role])
            raise UsageError(f"{where} has type {printable(schema) or 'none'}; the {role} can be {legal}")
        encoding = "json" if schema.startswith("pfcli.") else "cdr"
        if channel.encoding != encoding:
            raise UsageError(
                f"{where} ({printable(schema)}) is encoded as {printable(channel.encoding)!r}; pfcli reads it as {encoding}"
            )
        if frames:
            return Source(role, channel, *_of_transform(role, frames), where)
        return Source(
            role, channel, decoder(role, schema), json_messages.stamp_of if encoding == "json" else None, where
        )

    def _decoded(
        self, source: Source, buffer: Any, offset: int, length: int, stamp_ns: int, mounts: dict[str, Mount]
    ) -> Event | None:
        """The event of a message in the base frame; None where it cannot be read, which is counted."""
        try:
            event, frame = source.decode(buffer, offset, length, stamp_ns)
            trouble = plausible.fault(event)
            if trouble:
                raise ValueError(trouble)
            mount = self._mount(source, frame, mounts) if isinstance(event, _MOUNTED) else None
        except KeyError:
            return None
        except (ValueError, OverflowError, struct.error) as error:
            note = f"{source.where}: a message {printable(str(error))}; it is skipped"
            self.dropped.add("unreadable message", note)
            return None
        self.dropped.read[source.role] += 1
        return event if mount is None else self._placed(source, event, frame, mount)

    def _mount(self, source: Source, frame: str, mounts: dict[str, Mount]) -> Mount:
        """Where the sensor sits. A frame that nobody knows is an error of the set-up, and one of the message where others of
        the topic had one that is known."""
        found = mounts.get(frame)
        if found is None:
            try:
                found = self._extrinsics.mount(frame, self.path, source.channel.topic)
            except LogError:
                if self.dropped.read[source.role]:
                    raise ValueError(f"names the frame {frame!r}, which nothing else does") from None
                raise
            mounts[frame] = found
        return found

    def _placed(self, source: Source, event: Any, frame: str, mount: Mount) -> Event:
        """A reading in the base frame."""
        if isinstance(event, Scan):
            if not mount.flipped:
                return Scan(*event[:6], mount.pose)
            return event._replace(
                mount=mount.pose,
                angle_min_rad=-event.angle_min_rad,
                angle_increment_rad=-event.angle_increment_rad,
            )
        if isinstance(event, Range):
            return event._replace(topic=source.channel.topic, mount=mount.pose)
        if not mount.upright:
            raise UsageError(
                f"{source.where}: frame {printable(frame)!r} is not upright; give points on the ground in a frame whose z"
                " points up, or say --extrinsic base_link:FRAME=x,y,yaw"
            )
        if isinstance(event, Heading):
            return event._replace(yaw_rad=math.remainder(event.yaw_rad - mount.pose.yaw_rad, 2 * math.pi))
        if isinstance(event, Landmarks) and self.settings.landmark_ranges == "depth":
            event = vision.distances(event, source.where, self.dropped)
        return vision.placed(event, mount.pose, self.settings.image, source.where, self.dropped)


def _wanted(sources: Sequence[Source]) -> Wanted:
    """What a replay of these sources asks of the containers."""
    return Wanted(frozenset(source.channel.id for source in sources))


def _with_schema(role: str, channel: Channel) -> Channel:
    """A channel without a schema plays a role by the first type that the role has in its encoding."""
    if channel.schema_name:
        return channel
    kinds = [k for k in ROLES[role] if k.startswith("pfcli.") == (channel.encoding == "json")]
    return channel._replace(schema_name=kinds[0]) if kinds else channel


def _fits(role: str, topic: str, schema: str) -> bool:
    """Types that could play several roles are told apart by the topic's name."""
    named_truth = any(word in topic.lower() for word in _TRUTH_NAMES)
    if schema in ("nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"):
        return named_truth == (role == "truth")
    if role == "compass" and schema == "sensor_msgs/msg/Imu":
        return "compass" in topic.lower()
    return topic == SOURCE_STAMP_TOPIC if role == "source_stamp" else True


def _of_transform(role: str, frames: str) -> tuple[Decoder, Stamp]:
    """Read `parent.child` out of /tf messages as odometry or truth; its stamp is that of the transform."""
    parent, _, child = frames.partition(".")
    kind = Truth if role == "truth" else Odometry

    def find(buffer: Any, offset: int, length: int) -> Transform | None:
        for t in transforms(buffer, offset, length):
            if t.parent.lstrip("/") == parent and t.child.lstrip("/") == child:
                return t
        return None

    def stamp(payload: bytes) -> int | None:
        found = find(payload, 0, len(payload))
        return None if found is None else found.stamp_ns

    def decode(buffer: Any, offset: int, length: int, stamp_ns: int) -> tuple[Event, str]:
        found = find(buffer, offset, length)
        if found is None:
            raise KeyError
        return kind(stamp_ns, *found.translation[:2], yaw_of(*found.rotation)), ""

    return decode, stamp
