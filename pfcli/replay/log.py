"""Recordings as one time-ordered stream of events, as fast as the disk gives them and in bounded memory.

The order is total: (stamp, rank of the topic's role, sequence), made by a reorder buffer. Messages are decoded only
where a role of the run asks for their topic. What is lost on the way is counted, never silent.
"""

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pfcli.dropped import Dropped
from pfcli.errors import UsageError, printable
from pfcli.events import Event, Scan
from pfcli.formats import json_messages
from pfcli.formats.canonical import Canonical
from pfcli.formats.limits import Reading
from pfcli.formats.messages import SECOND, decoder
from pfcli.formats.reader import Channel, Wanted
from pfcli.formats.recording import Recording
from pfcli.formats.roles import MANY, ROLES
from pfcli.replay import cuts, plausible, stated_ranges
from pfcli.replay.frames.base_readings import BaseReadings, Setup
from pfcli.replay.frames.log_frames import LogFrames
from pfcli.replay.frames.robot_frames import Wanted as WantedFrames
from pfcli.replay.frames.transform_source import pair_of
from pfcli.replay.reorder import Heard, Message, Reorder, Source, Waiting
from pfcli.replay.settings import Settings

SOURCE_STAMP_TOPIC = "/source_stamp"
_TRUTH_NAMES = ("truth", "ground_truth", "groundtruth", "mocap", "reference")
_POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped", "sensor_msgs/msg/NavSatFix")
_COMMAND = "geometry_msgs/msg/Twist"
_LAG_S, _LAGS = 0.9, 200
_VISION = ("lines", "landmarks")
_PLACES = 10
"""So many damaged places of a log are named; the others are counted."""


DEFAULTS = Settings()


class Log:
    """An opened recording, of one part or more: its channels are known, its events can be replayed any number of times."""

    def __init__(self, paths: Path | Sequence[Path], settings: Settings = DEFAULTS) -> None:
        self.paths = [paths] if isinstance(paths, Path) else list(paths)
        self.settings = settings
        self.dropped = Dropped()
        recording = Recording(self.paths, Reading(settings.limits.chunk_mib))
        self._file = Canonical(recording, settings.limits.chunk_mib)
        self._notes = recording.notes
        self.path = self._file.path
        self.damage = f" ({self._file.losses[0].partition(': ')[2]})" if self._file.losses else ""
        """What a survey that found damage says of it, for messages about what the log lacks."""
        wanted = WantedFrames(settings.base_frame, settings.robot, tuple(settings.extrinsics))
        self.frames = LogFrames(self._file, self.path, wanted)

    def __repr__(self) -> str:
        return f"<Log {', '.join(map(str, self.paths))}: {', '.join(map(printable, self.topics())) or 'no topics'}>"

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
        if "twist" not in self.settings.topics:
            found["twist"] = self._measured(found.get("twist", []), bool(found.get("odometry")))
        return {
            role: self._own(topics) if role not in self.settings.topics else topics for role, topics in found.items()
        }

    def _own(self, topics: list[str]) -> list[str]:
        """Topics of the robot that --robot names, where it has some."""
        name = self.settings.robot.strip("/")
        return [t for t in topics if t.strip("/").startswith(f"{name}/")] or topics if name else topics

    def _measured(self, topics: list[str], odometry: bool) -> list[str]:
        """Speeds without a stamp are commands: they count where the log has no other speeds, and no odometry."""
        measured = [t for t in topics if self.topics()[t] != _COMMAND]
        return measured if measured or odometry else topics

    def only_commands(self) -> bool:
        """Whether all speeds that the log has are commands, which nobody has measured."""
        return "twist" not in self.settings.topics and all(
            self.topics()[t] == _COMMAND for t in self.roles().get("twist", [])
        )

    def take_transforms(self) -> bool:
        """Take the odometry from /tf where no topic has it; False where /tf has none. Raises UsageError where there are
        several."""
        if self.roles().get("odometry"):
            return True
        found = self.frames.proposed()
        if len(found) > 1:
            flags = ", ".join(f"--topic odometry={printable(t)}" for t in found)
            raise UsageError(f"{self.path}: several transforms can be the odometry: {flags}; choose one")
        if found:
            self.settings = self.settings._replace(topics={**self.settings.topics, "odometry": found[0]})
        return bool(found)

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
        if len(topics) > 1 and (role not in MANY or (role == "scan" and role not in self.settings.topics)):
            names = ", ".join(printable(t) for t in topics)
            several = f", or several scanners at once with --topic scan={','.join(topics)}" if role == "scan" else ""
            raise UsageError(
                f"{self.path}: several topics can be the {role}: {names}; choose with --topic {role}=TOPIC{several}"
            )
        return topics[0] if topics else None

    def events(self, roles: Sequence[str], heard: Heard | None = None) -> Iterator[Event]:
        """Events of the topics that play `roles`, in the total order; `heard` is told of their times."""
        self.dropped, reading = Dropped(), self.settings
        self.frames.settle(self._odometry(roles))
        sources = [s for role in roles for s in self._sources(role)]
        self.frames.prepare(sources)
        setup = Setup(reading.image, reading.landmark_ranges, reading.band or self.frames.band(sources))
        placed = BaseReadings(self.frames.robot, setup, self.dropped)
        offsets = {role: int(s * SECOND) for role, s in reading.offsets_s.items()}
        room = int(reading.limits.buffer_mib * 2**20)
        waiting = Waiting(int(reading.reorder_s * SECOND), room, reading.clock, offsets)
        order = Reorder(self.path, sources, waiting, (reading.start_s, reading.end_s), self.dropped, heard)
        self._tops = stated_ranges.tops(self._file, sources, self.dropped)
        messages = order.messages(self._file.batches(_wanted(sources)))
        events = self._read(messages, placed)
        yield from cuts.without(events, reading.cuts, lambda: order.first_ns) if reading.cuts else events
        for note in self.frames.notes():
            self.dropped.add("quaternion", note)
        if self.frames.tree.scaled:
            self.dropped.read["transforms whose quaternion was normalised"] = len(self.frames.tree.scaled)
        for note in self._file.losses:
            self.dropped.add("damaged place", note, _PLACES)
        self.dropped.notes += self._notes
        if self._file.missing:
            self.dropped.counts["missing message"] += self._file.missing

    def _read(self, messages: Iterator[Message], placed: BaseReadings) -> Iterator[Event]:
        """The events of messages that can be read."""
        for source, buffer, offset, length, stamp_ns in messages:
            event = self._decoded(source, buffer, offset, length, stamp_ns, placed)
            if event is not None:
                yield event

    def clock_lag_s(self, role: str, other: str) -> float:
        """Seconds to add to the stamps of a role so that both roles are stamped as long before they were recorded; 0 where that
        is less than a second, which may be how long messages took."""
        first, second = self._ahead_s(role), self._ahead_s(other)
        lag = 0.0 if first is None or second is None else second - first
        return lag if abs(lag) > _LAG_S else 0.0

    def _ahead_s(self, role: str) -> float | None:
        """How much later than the recorder's time the stamps of a role are, in the median over some messages."""
        waiting = Waiting(0, 0, "header", {})
        for source in self._sources(role if role in ROLES else "odometry"):
            order = Reorder(self.path, [source], waiting, (None, None), Dropped())
            ahead: list[int] = []
            for batch in self._file.batches(Wanted(frozenset({source.channel.id}))):
                picked = np.flatnonzero(batch.channel == source.channel.id)
                stamps = order.stamps(source, batch, picked)
                ahead += (stamps - batch.log_ns[picked])[stamps >= 0].tolist()
                if len(ahead) >= _LAGS:
                    break
            if ahead:
                return float(np.median(ahead[:_LAGS])) / SECOND
        return None

    def _odometry(self, roles: Sequence[str]) -> str | None:
        """The topic whose child frame is the robot's base: the odometry that is read, else the first that the log has."""
        if "odometry" in roles:
            return self.choose("odometry")
        topics = self.roles().get("odometry", [])
        return topics[0] if topics else None

    def _sources(self, role: str) -> list[Source]:
        first = self.choose(role)
        topics = self.roles().get(role, []) if role in MANY else [first]
        sources: list[Source] = []
        for topic in topics:
            if topic is None:
                continue
            pair = pair_of(topic)
            if pair is not None:
                sources += self.frames.sources(role, pair, f"--topic {role}={topic}")
                continue
            channels = [c for c in self.channels if c.topic == topic]
            if not channels:
                have = ", ".join(printable(t) for t in self.topics()) or "none"
                raise UsageError(f"{self.path}: --topic {role}={topic}: no such topic; the log has {have}{self.damage}")
            sources += [self._source(role, _with_schema(role, c)) for c in channels]
        return sources

    def _source(self, role: str, channel: Channel) -> Source:
        """Raises UsageError where the role cannot be played by the channel's type or encoding."""
        where, schema = f"{self.path}: topic {printable(channel.topic)!r}", channel.schema_name
        if schema not in ROLES[role]:
            legal = ", ".join(ROLES[role])
            raise UsageError(f"{where} has type {printable(schema) or 'none'}; the {role} can be {legal}")
        encoding = "json" if schema.startswith("pfcli.") else "cdr"
        if channel.encoding != encoding:
            raise UsageError(
                f"{where} ({printable(schema)}) is encoded as {printable(channel.encoding)!r}; pfcli reads it as {encoding}"
            )
        whole = schema == "nav_msgs/msg/Odometry" and self.frames.elsewhere(channel)
        stamp = json_messages.stamp_of if encoding == "json" else None
        return Source(role, channel, decoder(role, schema, whole), stamp, where)

    def _decoded(
        self, source: Source, buffer: Any, offset: int, length: int, stamp_ns: int, placed: BaseReadings
    ) -> Event | None:
        """The event of a message in the base frame; None where it cannot be read, which is counted."""
        try:
            event, frame = source.decode(buffer, offset, length, stamp_ns)
            if self._tops and isinstance(event, Scan) and source.channel.id in self._tops:
                event = event._replace(range_max_m=self._tops[source.channel.id])
            trouble = plausible.fault(event)
            if trouble:
                raise ValueError(trouble)
            found = placed(source, event, frame)
        except KeyError:
            return None
        except (ValueError, OverflowError, struct.error) as error:
            note = f"{source.where}: a message {printable(str(error))}; it is skipped"
            self.dropped.add("unreadable message", note)
            return None
        self.dropped.read[source.role] += 1
        return found


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
    if schema == "nav_msgs/msg/Odometry":
        return named_truth == (role == "truth")
    if schema in _POSES:
        # a pose of unknown origin is odometry only where the user says so, and a robot's own localisation is no truth
        return role == "truth" and named_truth
    if role == "compass" and schema == "sensor_msgs/msg/Imu":
        return "compass" in topic.lower()
    return topic == SOURCE_STAMP_TOPIC if role == "source_stamp" else True
