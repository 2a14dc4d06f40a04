"""Which frame is the robot's base, and where each sensor sits in it."""

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from pfcli.core import rigid
from pfcli.core.rigid import Motion
from pfcli.errors import LogError, UsageError, printable
from pfcli.events import Pose2
from pfcli.replay.frames.transform_tree import CONSTANT, FLAG, MOVING, Chain, Tree, agreed, spaces_above

STANDARD = ("base_link", "base_footprint", "base")
"""Names of a robot's base (REP 105, REP 120), the likeliest first."""
_FLOOR = "base_footprint"
LEVEL_RAD = 1e-3
"""So little tilt is level: at 30 m a beam is 3 cm off its height."""

STEEPEST_RAD = math.radians(45.0)
"""A scanner whose plane leans more sees floor and ceiling rather than walls."""


class Mount(NamedTuple):
    """A sensor seen from the base frame, in space and in the plane; tilt_rad: of its plane; height_m: above the floor, or
    above the base frame where the log has no base_footprint."""

    motion: Motion
    pose: Pose2
    tilt_rad: float
    height_m: float

    @property
    def flipped(self) -> bool:
        """Mounted upside down."""
        return bool(self.motion[2, 2] < 0)

    @property
    def level(self) -> bool:
        """Whether the sensor's plane is the floor's."""
        return self.tilt_rad < LEVEL_RAD


def mount_of(motion: Motion, floor_m: float = 0.0) -> Mount:
    """The mount of a sensor whose base has the floor at the height `floor_m`."""
    pose = Pose2(float(motion[0, 3]), float(motion[1, 3]), rigid.yaw_of(motion))
    return Mount(motion, pose, rigid.tilt_of(motion), float(motion[2, 3]) - floor_m)


class Wanted(NamedTuple):
    """What the user says of frames: --base-frame, --robot and --extrinsic."""

    base: str = ""
    robot: str = ""
    extrinsics: tuple[str, ...] = ()


class RobotFrames:
    """The frames of one robot of a recording.

    more(): reads the transforms on /tf into the tree, False where there are none, or they are known; called only where
    /tf_static does not tell.
    """

    def __init__(self, tree: Tree, wanted: Wanted, path: object, more: Callable[[], bool]) -> None:
        self.tree, self._wanted, self._path, self._more = tree, wanted, path, more
        self.base = ""
        """The robot's base frame; '' while nothing names it."""
        self.said = False
        for flag in wanted.extrinsics:
            add_flag(tree, flag)
            self.said = True

    def spaces(self, topic: str) -> list[str]:
        """Namespaces whose transforms count for a topic, nearest first."""
        if self._wanted.robot:
            return [self._wanted.robot.strip("/"), ""]
        return spaces_above(topic)

    def name(self, frame: str, topic: str) -> str:
        """A frame by the name that the tree has for it: with or without its robot's prefix."""
        plain = frame.lstrip("/")
        spaces = self.spaces(topic)
        known = self.tree.frames()
        prefixes = [s for s in spaces if s]
        options = [plain, *(f"{s}/{plain}" for s in prefixes)]
        options += [plain.removeprefix(f"{s}/") for s in prefixes if plain.startswith(f"{s}/")]
        return next((option for option in options if option in known), plain)

    def settle(self, child: str, topic: str) -> None:
        """Choose the base frame: as asked, else by the child frame of the odometry on `topic` ('' where there is none)."""
        if self._wanted.base:
            self.base = self._asked(topic)
        elif child:
            self.base = self._of_odometry(self.name(child, topic), topic)
        else:
            self.base = next((n for n in self._bases("", topic) if n in self.tree.frames()), "")

    def _asked(self, topic: str) -> str:
        name = self.name(self._wanted.base, topic)
        while name not in self.tree.frames() and self._more():
            name = self.name(self._wanted.base, topic)
        if self.tree.edges and name not in self.tree.frames():
            raise UsageError(
                f"{self._path}: --base-frame {printable(self._wanted.base)}: the log has no such frame; its transforms are"
                f" {self.tree.text()}"
            )
        return name

    def _of_odometry(self, child: str, topic: str) -> str:
        """The standard base that the odometry's child sits on, else the child itself."""
        if child.rpartition("/")[2] in STANDARD:
            return child
        while True:
            for name in self._bases(child, topic):
                if name in self.tree.frames() and self.chain(child, name, topic, CONSTANT) is not None:
                    return name
            if not self._more():
                break
        strangers = [n for n in self._bases(child, topic) if n in self.tree.frames()]
        if strangers:
            raise LogError(
                f"{self._path}: topic {printable(topic)!r}, field 'child_frame_id': the odometry is of"
                f" {printable(child)!r}, and nothing says where that sits on {printable(strangers[0])!r}; the transforms are"
                f" {self.tree.text()}; give --extrinsic {printable(strangers[0])}:{printable(child)}=x,y,z,roll,pitch,yaw,"
                f" or --base-frame {printable(child)}"
            )
        return child

    def _bases(self, frame: str, topic: str) -> list[str]:
        """Names that a base may have beside a frame and a topic: with the frame's prefix, with the topic's, bare."""
        own = frame.rpartition("/")[0]
        prefixes = dict.fromkeys([own, *self.spaces(topic), ""])
        return [f"{p}/{n}" if p else n for p in prefixes for n in STANDARD]

    def chain(self, source: str, target: str, topic: str, least: int = MOVING) -> Chain | None:
        """The way from `source` to `target` for readings of `topic`: by its own namespaces, else by those of the one robot
        that has it. Raises LogError where two robots differ about it, or one topic contradicts itself."""
        own = self.spaces(topic)
        where = f"{self._path}: topic {printable(topic)!r}"
        found = self.tree.chain(source, target, own, least)
        if found is not None or self._wanted.robot:
            return None if found is None else agreed(found, where)
        others: list[tuple[str, Chain]] = []
        for space in self.tree.spaces():
            way = self.tree.chain(source, target, [space, *own], least) if space not in own else None
            if way is not None:
                others.append((space, way))
        for space, way in others[1:]:
            first = others[0]
            if way.moving or first[1].moving or not rigid.same(way.at(0), first[1].at(0)):
                raise LogError(
                    f"{where}: the robots {first[0]!r} and {space!r} both have {printable(source)} on {printable(target)}, at"
                    f" different places: {_place(first[1])} and {_place(way)}; say which with --robot, or give --extrinsic"
                )
        return agreed(others[0][1], where) if others else None

    def way_to_base(self, frame: str, topic: str) -> Chain | None:
        """The way from a frame to the base; None where nothing leads there."""
        name = self.name(frame, topic)
        if not name or name == self.base:
            return Chain(())
        while True:
            for base in self._targets(name, topic):
                found = Chain(()) if base == name else self.chain(name, base, topic)
                if found is not None:
                    return found
            if not self._more():
                return None
            name = self.name(frame, topic)

    def _targets(self, name: str, topic: str) -> Iterable[str]:
        """The base; and where nothing joins it to a standard name, such a name: it is one by what it is called."""
        yield from (self.base,) if self.base else ()
        if not self.base or self.base.rpartition("/")[2] in STANDARD:
            apart = (b for b in self._bases(self.base or name, topic) if b != self.base)
            yield from (b for b in apart if self._apart(b, topic))

    def _apart(self, other: str, topic: str) -> bool:
        return not self.base or self.chain(other, self.base, topic, CONSTANT) is None

    def mount(self, frame: str, topic: str, stamp_ns: int) -> tuple[Mount, bool]:
        """Where `frame` sits on the robot, and whether it always sits there. Raises LogError naming the flag that would say
        it."""
        way = self.way_to_base(frame, topic)
        if way is None:
            named, base = printable(frame.lstrip("/")), printable(self.base or STANDARD[0])
            raise LogError(
                f"{self._path}: topic {printable(topic)!r}, field 'frame_id': no transform from {base} to {named!r}; the"
                f" log's transforms are {self.tree.text()}; give --extrinsic {base}:{named}=x,y,yaw, or --base-frame"
            )
        return mount_of(way.at(stamp_ns), self.floor_m(topic)), not way.moving

    def floor_m(self, topic: str) -> float:
        """Height of the floor in the base frame (m)."""
        own = self.base.rpartition("/")[0]
        name = f"{own}/{_FLOOR}" if own else _FLOOR
        if self.base == name or name not in self.tree.frames():
            return 0.0
        way = self.chain(name, self.base, topic, CONSTANT) if self.base else None
        return 0.0 if way is None else float(way.at(0)[2, 3])


def _place(chain: Chain) -> str:
    return "a place that moves" if chain.moving else rigid.text(chain.at(0))


def add_flag(tree: Tree, flag: str) -> None:
    """Take a `parent:child=x,y,yaw` flag, or `=x,y,z,roll,pitch,yaw` (m, rad). Raises UsageError."""
    names, _, numbers = flag.partition("=")
    parent, _, child = names.partition(":")
    try:
        values = [float(v) for v in numbers.split(",")]
        if len(values) not in (3, 6) or not parent or not child or not math.isfinite(sum(values)):
            raise ValueError
    except ValueError:
        raise UsageError(
            f"--extrinsic {flag}: expected parent:child=x,y,yaw or parent:child=x,y,z,roll,pitch,yaw (m, rad)"
        ) from None
    if len(values) == 3:
        x, y, yaw = values
        tree.put("", parent, child, planar(x, y, yaw), FLAG)
    else:
        tree.put("", parent, child, rigid.from_euler(values[:3], *values[3:]), FLAG)


def planar(x: float, y: float, yaw: float) -> Motion:
    """A motion in the plane."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1.0]])
