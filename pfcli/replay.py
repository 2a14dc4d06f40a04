"""MCAP logs as one time-ordered stream of events, as fast as the disk gives them and in bounded memory.

The order is total: (stamp, rank of the topic's role, sequence), made by a reorder buffer. Messages are decoded only
where a role of the run asks for their topic. What is lost on the way is counted, never silent.
"""

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli import vision
from pfcli.core.jit import kernel
from pfcli.errors import UsageError, printable
from pfcli.events import Event, Heading, Landmarks, LinePoints, Odometry, Range, Scan, Truth
from pfcli.formats import json_messages
from pfcli.formats.extrinsics import Extrinsics, Mount, from_transform
from pfcli.formats.mcap_records import Batch, Channel, McapFile
from pfcli.formats.messages import (
    MANY,
    RANK,
    ROLES,
    SECOND,
    Decoder,
    decoder,
    stamp_in_header,
    transforms,
    yaw_of,
)
from pfcli.loss import Loss

SOURCE_STAMP_TOPIC = "/source_stamp"
_TF = "tf2_msgs/msg/TFMessage"
_TRUTH_NAMES = ("truth", "ground_truth", "groundtruth", "mocap", "reference")
_MOUNTED = (Scan, Range, LinePoints, Landmarks, Heading)
_VISION = ("lines", "landmarks")
_FAR_NS = 10 * 365 * 86400 * SECOND


class Settings(NamedTuple):
    """How a log is read: role -> topic, clock, window (s from the log's first stamp), offsets (s), extrinsics, the image of
    vision that gives pixels, and what landmarks' ranges are (one of `vision.RANGES`)."""

    topics: Mapping[str, str] = {}
    clock: str = "header"
    start_s: float | None = None
    end_s: float | None = None
    reorder_s: float = 2.0
    offsets_s: Mapping[str, float] = {}
    extrinsics: Sequence[str] = ()
    image: vision.Image | None = None
    landmark_ranges: str = vision.RANGES[0]


DEFAULTS = Settings()


class Log:
    """An opened log: its channels are known, its events can be replayed any number of times."""

    def __init__(self, path: Path, settings: Settings = DEFAULTS) -> None:
        self.path = path
        self.settings = settings
        self.loss = Loss()
        self._file = McapFile(path)
        self._file.survey()
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
            for batch in self._file.batches():
                for k in np.flatnonzero(np.isin(batch.channel, list(static))).tolist():
                    for t in transforms(batch.data, int(batch.offset[k]), int(batch.length[k])):
                        found.add(t.parent, t.child, from_transform(t.translation, t.rotation))
        self._file.losses.clear()
        self._file.partial = False
        found.add_flags(self.settings.extrinsics)
        return found

    def events(self, roles: Sequence[str]) -> Iterator[Event]:
        """Events of the topics that play `roles`, in the total order."""
        sources = [s for role in roles for s in self._sources(role)]
        self.loss = Loss()
        yield from _Merge(self, sources, self._extrinsics).events()
        for note in self._file.losses:
            self.loss.add("damaged", note)

    def _sources(self, role: str) -> list["_Source"]:
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
                raise UsageError(f"{self.path}: --topic {role}={topic}: no such topic; the log has {have}")
            for c in channels:
                if not frames and c.schema_name not in ROLES[role]:
                    legal = ", ".join(ROLES[role])
                    raise UsageError(
                        f"{self.path}: topic {printable(topic)!r} has type {printable(c.schema_name) or 'none'};"
                        f" the {role} can be {legal}"
                    )
                sources.append(_Source(role, c, _tf_decoder(role, frames) if frames else decoder(role, c.schema_name)))
        return sources


def _fits(role: str, topic: str, schema: str) -> bool:
    """Types that could play several roles are told apart by the topic's name."""
    named_truth = any(word in topic.lower() for word in _TRUTH_NAMES)
    if schema in ("nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"):
        return named_truth == (role == "truth")
    if role == "compass" and schema == "sensor_msgs/msg/Imu":
        return "compass" in topic.lower()
    return topic == SOURCE_STAMP_TOPIC if role == "source_stamp" else True


class _Source(NamedTuple):
    role: str
    channel: Channel
    decode: Decoder


def _tf_decoder(role: str, frames: str) -> Decoder:
    """Read `parent.child` out of /tf messages as odometry or truth."""
    parent, _, child = frames.partition(".")
    kind = Truth if role == "truth" else Odometry

    def decode(buffer: Any, offset: int, length: int, stamp_ns: int) -> tuple[Event, str]:
        for t in transforms(buffer, offset, length):
            if t.parent.lstrip("/") == parent and t.child.lstrip("/") == child:
                return kind(t.stamp_ns, t.translation[0], t.translation[1], yaw_of(*t.rotation)), ""
        raise KeyError

    return decode


@kernel
def _header_stamps(data, offset, length, out):  # type: ignore[no-untyped-def]
    """Stamps (ns) of ROS headers; -1 where the payload is too short or not little endian."""
    for k in range(offset.size):
        at = offset[k]
        if length[k] < 12 or data[at + 1] & 1 == 0:
            out[k] = -1
            continue
        sec = np.int64(0)
        nsec = np.int64(0)
        for j in range(4):
            sec |= np.int64(data[at + 4 + j]) << (8 * j)
            nsec |= np.int64(data[at + 8 + j]) << (8 * j)
        if sec >= 1 << 31:
            sec -= 1 << 32
        out[k] = sec * 1_000_000_000 + nsec if sec >= 0 and nsec < 1_000_000_000 else -1


class _Merge:
    """The reorder buffer: payloads wait until nothing earlier can come any more."""

    def __init__(self, log: Log, sources: list[_Source], extrinsics: Extrinsics) -> None:
        self._log = log
        self._sources = sources
        self._extrinsics = extrinsics
        self._horizon = int(log.settings.reorder_s * SECOND)
        self._buffers: dict[int, bytes | memoryview] = {}
        self._rows = np.empty((0, 7), np.int64)
        self._count = 0
        self._latest = -(1 << 62)
        self._first: int | None = None
        self._mounts: dict[str, Mount] = {}

    def _where(self, source: _Source) -> str:
        """What messages about a topic begin with."""
        return f"{self._log.path}: topic {printable(source.channel.topic)!r}"

    def events(self) -> Iterator[Event]:
        for batch in self._log._file.batches():
            self._take(batch)
            yield from self._release(self._latest - self._horizon)
        yield from self._release(1 << 62)

    def _take(self, batch: Batch) -> None:
        """Stamp the wanted messages of a batch and put them into the buffer."""
        key = len(self._buffers) and max(self._buffers) + 1
        view = np.frombuffer(batch.data, np.uint8)
        parts = []
        for index, source in enumerate(self._sources):
            picked = np.flatnonzero(batch.channel == source.channel.id)
            if picked.size == 0:
                continue
            rows = np.empty((picked.size, 7), np.int64)
            rows[:, 0] = self._stamps(source, batch, picked, view)
            rows[:, 0] += int(self._log.settings.offsets_s.get(source.role, 0.0) * SECOND)
            rows[:, 1] = RANK[source.role]
            rows[:, 2] = picked + self._count
            rows[:, 3], rows[:, 4] = index, key
            rows[:, 5], rows[:, 6] = batch.offset[picked], batch.length[picked]
            parts.append(rows)
        self._count += batch.channel.size
        if not parts:
            return
        self._buffers[key] = batch.data
        rows = np.concatenate(parts)
        self._rows = np.concatenate([self._rows, self._in_time(rows[np.argsort(rows[:, 2])])])

    def _in_time(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Rows in file order without those that have no usable stamp or come later than the horizon can mend.

        What is late is decided by the order in the file alone, whatever the chunks.
        """
        bad = rows[:, 0] < 0
        if self._latest > 0:
            bad |= np.abs(rows[:, 0] - self._latest) > _FAR_NS
        for index in rows[bad, 3].tolist():
            where = self._where(self._sources[index])
            self._log.loss.add("bad stamp", f"{where}, field 'stamp': not a usable time; such messages are skipped")
        rows = rows[~bad]
        if rows.size == 0:
            return rows
        newest = np.maximum.accumulate(np.maximum(rows[:, 0], self._latest))
        behind = newest - rows[:, 0]
        self._latest = int(newest[-1])
        for k in np.flatnonzero(behind > self._horizon).tolist():
            where = self._where(self._sources[rows[k, 3]])
            self._log.loss.add(
                "late",
                f"{where}: time goes back by {behind[k] / SECOND:.3f} s; a larger --reorder mends it, or --time log",
            )
        return rows[behind <= self._horizon]

    def _stamps(
        self, source: _Source, batch: Batch, picked: NDArray[np.int64], view: NDArray[np.uint8]
    ) -> NDArray[np.int64]:
        clock = self._log.settings.clock
        if clock != "header" or (source.channel.encoding != "json" and not stamp_in_header(source.channel.schema_name)):
            return (batch.publish_ns if clock == "publish" else batch.log_ns)[picked]
        out = np.empty(picked.size, np.int64)
        if source.channel.encoding == "json":
            for k, (at, size) in enumerate(zip(batch.offset[picked], batch.length[picked], strict=True)):
                try:
                    out[k] = json_messages.stamp_of(bytes(batch.data[at : at + size]))
                except ValueError:
                    out[k] = -1
            return out
        _header_stamps(view, batch.offset[picked], batch.length[picked], out)
        return out

    def _release(self, until: int) -> Iterator[Event]:
        """Emit what is at least as old as `until`."""
        ready = self._rows[:, 0] < until
        if not ready.any():
            return
        rows, self._rows = self._rows[ready], self._rows[~ready]
        rows = rows[np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))]
        if self._first is None:
            self._first = int(rows[0, 0])
        low, high = self._window()
        rows = rows[(rows[:, 0] >= low) & (rows[:, 0] <= high)]
        for stamp, _, _, index, key, offset, length in rows.tolist():
            event = self._decode(self._sources[index], self._buffers[key], offset, length, stamp)
            if event is not None:
                yield event
        alive = set(np.unique(self._rows[:, 4]).tolist())
        self._buffers = {key: data for key, data in self._buffers.items() if key in alive}

    def _window(self) -> tuple[int, int]:
        assert self._first is not None
        start, end = self._log.settings.start_s, self._log.settings.end_s
        low = self._first + int(start * SECOND) if start is not None else -(1 << 62)
        return low, self._first + int(end * SECOND) if end is not None else 1 << 62

    def _decode(self, source: _Source, data: Any, offset: int, length: int, stamp: int) -> Event | None:
        try:
            event, frame = source.decode(data, offset, length, stamp)
        except KeyError:
            return None
        except (ValueError, struct.error) as error:
            where = self._where(source)
            self._log.loss.add("unreadable message", f"{where}: a message {printable(str(error))}; it is skipped")
            return None
        self._log.loss.read[source.role] += 1
        if isinstance(event, _MOUNTED):
            mount = self._mounts.get(frame)
            if mount is None:
                mount = self._extrinsics.mount(frame, self._log.path, source.channel.topic)
                self._mounts[frame] = mount
            if isinstance(event, LinePoints | Landmarks | Heading):
                if not mount.upright:
                    where = self._where(source)
                    raise UsageError(
                        f"{where}: frame {printable(frame)!r} is not upright; give points on the ground in a frame whose z"
                        " points up, or say --extrinsic base_link:FRAME=x,y,yaw"
                    )
                if isinstance(event, Heading):
                    return event._replace(yaw_rad=math.remainder(event.yaw_rad - mount.pose.yaw_rad, 2 * math.pi))
                if isinstance(event, Landmarks) and self._log.settings.landmark_ranges == "depth":
                    event = vision.distances(event, self._where(source), self._log.loss)
                return vision.placed(event, mount.pose, self._log.settings.image, self._where(source), self._log.loss)
            if isinstance(event, Range):
                return event._replace(topic=source.channel.topic, mount=mount.pose)
            if mount.flipped:
                return event._replace(
                    mount=mount.pose,
                    angle_min_rad=-event.angle_min_rad,
                    angle_increment_rad=-event.angle_increment_rad,
                )
            return Scan(*event[:6], mount.pose)
        return event
