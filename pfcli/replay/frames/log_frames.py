"""The frames of an opened recording: read from its transforms as far as they are asked for."""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfcli.errors import UsageError, printable
from pfcli.events import Scan
from pfcli.formats.messages import decoder
from pfcli.formats.reader import Wanted as WantedMessages
from pfcli.replay.frames import tf_survey
from pfcli.replay.frames.ceiling import EVERY, MOST, ceiling_m, heights
from pfcli.replay.frames.robot_frames import STANDARD, STEEPEST_RAD, Mount, RobotFrames, Wanted
from pfcli.replay.frames.transform_source import Pair, carrier_of, pair_of, proposals, reader_of
from pfcli.replay.frames.transform_tree import MOVING, Chain, Edge, Tree
from pfcli.replay.reorder import Source
from pfcli.replay.settings import Band

_ODOMETRY = "nav_msgs/msg/Odometry"
_PLACED = ("scan", "range", "imu", "compass", "lines", "landmarks", "twist")
"""Roles whose readings are of a sensor somewhere on the robot."""


class LogFrames:
    """The transform tree of a recording, and its robot's base frame."""

    def __init__(self, file: tf_survey.File, path: object, wanted: Wanted) -> None:
        self._file, self._path, self._wanted = file, path, wanted
        tf = {c.id: c.topic for c in file.channels.values() if c.schema_name == tf_survey.TF}
        self._static = {k: topic for k, topic in tf.items() if tf_survey.is_static(topic)}
        self._moving = {k: topic for k, topic in tf.items() if k not in self._static}
        self.tree = Tree()
        if self._static:
            tf_survey.survey(self.tree, file, self._static)
        self.robot = RobotFrames(self.tree, wanted, path, self._more)
        self._surveyed = False
        self._children: dict[int, str] = {}
        self._settled: str | None = ""

    def _more(self) -> bool:
        """Read what stands still, and what moves, on /tf; False where that is known."""
        if self._surveyed or not self._moving:
            return False
        self._surveyed = True
        tf_survey.survey(self.tree, self._file, self._moving)
        return True

    def settle(self, topic: str | None) -> None:
        """Choose the base frame by the odometry on `topic`."""
        if self._settled == topic:
            return
        self._settled = topic
        pair = pair_of(topic) if topic else None
        if pair is not None:
            self._more()
            self.robot.settle(pair.child, pair.topic)
            return
        channel = next((c for c in self._file.channels.values() if c.topic == topic), None)
        self.robot.settle(self._child(channel) if channel is not None else "", topic or "")

    def _child(self, channel: Any) -> str:
        """Child frame of an odometry's first message that can be read."""
        if channel.schema_name != _ODOMETRY or channel.encoding != "cdr":
            return ""
        if channel.id not in self._children:
            self._children[channel.id] = self._peek(channel)
        return self._children[channel.id]

    def _peek(self, channel: Any) -> str:
        source = Source("odometry", channel, decoder("odometry", _ODOMETRY), None, "")
        return next((frame for _, frame in self._first_frames([source])), "")

    def elsewhere(self, channel: Any) -> bool:
        """Whether an odometry's child is another frame than the base, and the log says where it sits."""
        child = self._child(channel)
        if not child:
            return False
        way = self.robot.way_to_base(child, channel.topic)
        return way is not None and bool(way.steps) and not np.array_equal(way.at(0), np.eye(4))

    def sources(self, role: str, pair: Pair, flag: str) -> list[Source]:
        """The channels that give a pair of frames, in `role`. Raises UsageError naming the pairs that there are."""
        channels = [c for c in self._file.channels.values() if c.topic == pair.topic and c.schema_name == tf_survey.TF]
        if not channels:
            have = ", ".join(printable(c.topic) for c in self._file.channels.values()) or "none"
            raise UsageError(f"{self._path}: {flag}: no such topic; the log has {have}")
        self._more()
        parent, child = (self.robot.name(name, pair.topic) for name in (pair.parent, pair.child))
        chain = self.robot.chain(child, parent, pair.topic)
        carrier = carrier_of(chain) if chain is not None else None
        if chain is None or carrier is None:
            raise UsageError(f"{self._path}: {flag}: {self._why_not(pair, chain)}")
        others = [edge for edge in chain.moving if edge is not carrier]
        tf_survey.collect(others, self._file, self._moving)
        decode, stamp = reader_of(role, chain, carrier)
        carrying = [c for c in self._file.channels.values() if c.topic == carrier.topic]
        where = f"{self._path}: topic {printable(f'{pair.topic}:{pair.parent}.{pair.child}')!r}"
        return [Source(role, channel, decode, stamp, where) for channel in carrying]

    def _why_not(self, pair: Pair, chain: Chain | None) -> str:
        asked = f"{printable(pair.parent)} -> {printable(pair.child)}"
        moving = [
            f"{printable(e.key.parent)} -> {printable(e.key.child)}"
            for e in self.tree.edges.values()
            if e.kind == MOVING
        ]
        have = f"what moves is {', '.join(moving)}" if moving else "nothing there moves"
        if chain is not None:
            return f"{asked} never changes; {have}"
        return f"/tf never has {asked}; {have}; the transforms are {self.tree.text()}"

    def proposed(self) -> list[str]:
        """Topics such as /tf:odom.base_link that give the odometry of a log that has no other, the likeliest alone."""
        self._more()
        own = self._wanted.robot.strip("/")
        edges = [e for e in self.tree.edges.values() if not own or own in (e.key.space, e.key.child.partition("/")[0])]
        found = proposals(edges, self._carries)
        return [f"{e.topic}:{e.key.parent}.{self._below(e)}" for e in found]

    def _carries(self, frame: str) -> bool:
        return self._base_below(frame) is not None

    def _below(self, edge: Edge) -> str:
        return self._base_below(edge.key.child) or edge.key.child

    def _base_below(self, frame: str) -> str | None:
        """The standard base frame that sits fast on `frame`, itself where it is one."""
        if self._wanted.base:
            options = [self._wanted.base]
        else:
            own = frame.rpartition("/")[0]
            options = [frame] if frame.rpartition("/")[2] in STANDARD else []
            options += [f"{own}/{name}" if own else name for name in STANDARD]
        for name in options:
            if name == frame or self.tree.chain(name, frame, self.tree.spaces(), MOVING - 1) is not None:
                return name
        return None

    def prepare(self, sources: Sequence[Source]) -> None:
        """Read what the mounts of these sources want of /tf, before a replay begins: nothing is read a second time then."""
        for source, frame in self._first_frames([s for s in sources if s.role in _PLACED]):
            topic = source.channel.topic
            way = self.robot.way_to_base(frame, topic)
            if way is not None:
                tf_survey.collect(way.moving, self._file, self._moving)
        self._surveyed = True

    def _first_frames(self, sources: list[Source]) -> list[tuple[Source, str]]:
        """The frame of each source's first message that can be read."""
        waiting = {source.channel.id: source for source in sources}
        found: list[tuple[Source, str]] = []
        for batch in self._file.batches(WantedMessages(frozenset(waiting))) if waiting else ():
            for ident in [k for k in waiting if (batch.channel == k).any()]:
                frame = _first_frame(waiting[ident], batch)
                if frame is not None:
                    found.append((waiting.pop(ident), frame))
            if not waiting:
                break
        return found

    def band(self, sources: Sequence[Source]) -> Band:
        """Heights that are walls, for the scanners among these that lean: up to the ceiling, where one shows."""
        channels = {s.channel.id: s for s in sources if s.role == "scan"}
        seen: list[NDArray[np.float64]] = []
        top = 0.0
        for source, frame in self._first_frames(list(channels.values())):
            way = self.robot.way_to_base(frame, source.channel.topic)
            if way is None or way.moving:
                continue
            mount, _ = self.robot.mount(frame, source.channel.topic, 0)
            if not mount.level and mount.tilt_rad < STEEPEST_RAD and mount.height_m > 0.0:
                seen += self._heights(source, mount)
                top = max(top, mount.height_m)
        return Band() if not seen else Band(Band().low_m, ceiling_m(np.concatenate(seen), top))

    def _heights(self, source: Source, mount: Mount) -> list[NDArray[np.float64]]:
        """Heights of the end points of some scans of the whole recording."""
        found: list[NDArray[np.float64]] = []
        for batch in self._file.batches(WantedMessages(frozenset({source.channel.id}))):
            for k in np.flatnonzero(batch.channel == source.channel.id)[::EVERY].tolist():
                try:
                    event, _ = source.decode(batch.data, int(batch.offset[k]), int(batch.length[k]), 0)
                except (ValueError, OverflowError, struct.error):
                    continue
                if isinstance(event, Scan) and len(found) < MOST:
                    found.append(heights(event, mount))
        return found

    def notes(self) -> list[str]:
        """What is said of transforms whose quaternions say nothing."""
        return [
            f"{self._path}: the transform of {printable(name)} has a quaternion that is all zero; it is taken as not turned"
            for name in sorted(self.tree.unturned)
        ]


def _first_frame(source: Source, batch: Any) -> str | None:
    for k in np.flatnonzero(batch.channel == source.channel.id).tolist():
        try:
            return source.decode(batch.data, int(batch.offset[k]), int(batch.length[k]), 0)[1]
        except (ValueError, KeyError, OverflowError, struct.error):
            continue
    return None
