"""The transforms of a recording as one graph: which frame hangs where, who says so, and the way from frame to frame."""

from array import array
from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from pfcli.core import rigid
from pfcli.core.rigid import Motion
from pfcli.errors import LogError, printable

SECOND = 1_000_000_000
_HOLD_NS = SECOND
"""So long before its first and after its last message a moving transform is taken to stand still."""
FLAG, STATIC, CONSTANT, MOVING = range(4)
"""How sure an edge is: said by a flag, by /tf_static, by a /tf that never changed, by one that moves."""
_SHOWN = 12


class Key(NamedTuple):
    """An edge: the namespace of its publisher, parent and child."""

    space: str
    parent: str
    child: str


class Edge:
    """One transform: its value where it stands still; where it moves, its values by time, once they are collected."""

    def __init__(self, key: Key, topic: str, kind: int, motion: Motion) -> None:
        self.key, self.topic, self.kind, self.motion = key, topic, kind, motion
        self.other: Motion | None = None
        """A second value that the same topic gives as well."""
        self.messages = 1
        self.stamps = array("q")
        self.rows = array("d")

    def at(self, stamp_ns: int) -> Motion:
        """The child in the parent then. Raises ValueError where the log does not say it."""
        if self.kind != MOVING:
            return self.motion
        stamps = np.frombuffer(self.stamps, np.int64)
        rows = np.frombuffer(self.rows, np.float64).reshape(-1, 7)
        k = int(np.searchsorted(stamps, stamp_ns))
        near = stamps[min(k, len(stamps) - 1)] - stamp_ns if k == 0 or k == len(stamps) else 0
        if len(stamps) == 0 or abs(int(near)) > _HOLD_NS:
            raise ValueError(f"has a stamp at which nobody gives the transform {self.key.parent} -> {self.key.child}")
        if k == 0 or k == len(stamps):
            row = rows[min(k, len(rows) - 1)]
            return rigid.from_quaternion(row[:3], row[3:])
        share = (stamp_ns - int(stamps[k - 1])) / int(stamps[k] - stamps[k - 1])
        return rigid.from_quaternion(*(part.tolist() for part in rigid.between(rows[k - 1], rows[k], share)))

    def collect(self, stamp_ns: int, row: tuple[float, ...]) -> None:
        """Take up a value of a moving edge; what goes back in time is left out."""
        if not self.stamps or stamp_ns > self.stamps[-1]:
            self.stamps.append(stamp_ns)
            self.rows.extend(row)


class Chain(NamedTuple):
    """The way from one frame to another: edges, each with whether it is walked from the parent to its child."""

    steps: tuple[tuple[Edge, bool], ...]

    @property
    def moving(self) -> list[Edge]:
        """The edges that move."""
        return [edge for edge, _ in self.steps if edge.kind == MOVING]

    def at(self, stamp_ns: int) -> Motion:
        """The first frame, seen from the last one."""
        out = np.eye(4)
        for edge, down in self.steps:
            step = edge.at(stamp_ns)
            out = (rigid.inverse(step) if down else step) @ out
        return out


class Tree:
    """All transforms of a recording. Names are without leading slashes; namespaces are those of the publishers' topics."""

    def __init__(self) -> None:
        self.edges: dict[Key, Edge] = {}
        self.unturned: set[str] = set()
        """Frames whose rotation is all zero, which is taken for none."""
        self.scaled: set[str] = set()
        """Frames whose quaternion was not of length 1."""

    def add(self, topic: str, parent: str, child: str, value: tuple[float, ...], kind: int = STATIC) -> None:
        """Take up a transform. value: x, y, z (m), and a quaternion x, y, z, w. A moving one is MOVING or, so far, CONSTANT."""
        self.put(topic, parent, child, self._motion(value, child), kind)

    def put(self, topic: str, parent: str, child: str, motion: Motion, kind: int = STATIC) -> None:
        """Take up a transform as a matrix."""
        key = Key(space_of(topic), parent.lstrip("/"), child.lstrip("/"))
        known = self.edges.get(key)
        if key.parent == key.child or (known is not None and known.kind < kind):
            return
        if known is None or known.kind > kind or kind == FLAG:
            self.edges[key] = Edge(key, topic, kind, motion)
            return
        known.messages += 1
        if not rigid.same(known.motion, motion):
            if kind == CONSTANT:
                known.kind = MOVING
            elif known.other is None:
                known.other = motion

    def _motion(self, value: tuple[float, ...], child: str) -> Motion:
        square = sum(v * v for v in value[3:])
        if square < 1e-12:
            self.unturned.add(child.lstrip("/"))
            return rigid.from_quaternion(value[:3], (0.0, 0.0, 0.0, 1.0))
        if abs(square - 1.0) > 0.01:
            self.scaled.add(child.lstrip("/"))
        return rigid.from_quaternion(value[:3], value[3:])

    def spaces(self) -> list[str]:
        """Namespaces that publish transforms, flags not counted."""
        return list(dict.fromkeys(e.key.space for e in self.edges.values() if e.kind != FLAG))

    def frames(self, space: str | None = None) -> set[str]:
        """Every frame, or those that a namespace's publishers name."""
        named = (k for k in self.edges if space is None or k.space == space)
        return {name for key in named for name in (key.parent, key.child)}

    def chain(self, source: str, target: str, spaces: Iterable[str], least: int = MOVING) -> Chain | None:
        """The way from `source` to `target` by edges of these namespaces, surest kind first, then the fewest edges.

        A nearer namespace (named earlier) hides the same edge of another one; least: the least sure kind to use.
        """
        order = {space: k for k, space in enumerate(spaces)}
        chosen: dict[tuple[str, str], Edge] = {}
        for edge in self.edges.values():
            if edge.key.space not in order and edge.kind != FLAG:
                continue
            pair = (edge.key.parent, edge.key.child)
            rank = (edge.kind != FLAG, order.get(edge.key.space, -1), edge.kind)
            held = chosen.get(pair)
            if held is None or rank < (held.kind != FLAG, order.get(held.key.space, -1), held.kind):
                chosen[pair] = edge
        # a flag that hangs a frame somewhere replaces what the log says of the same frame
        said = {edge.key.child for edge in chosen.values() if edge.kind == FLAG}
        edges = [e for e in chosen.values() if e.kind == FLAG or e.key.child not in said]
        for kind in range(STATIC, least + 1):
            steps = _walk([e for e in edges if e.kind <= kind], source, target)
            if steps is not None:
                return Chain(tuple(steps))
        return None

    def text(self) -> str:
        """The trees as one line, for messages: `odom > base_link (moves) > laser, imu`."""
        children: dict[str, list[Edge]] = {}
        for edge in self.edges.values():
            children.setdefault(edge.key.parent, []).append(edge)
        below = {edge.key.child for edge in self.edges.values()}
        roots = [name for name in children if name not in below] or list(children)[:1]
        return "; ".join(_branch(root, children, set()) for root in roots[:_SHOWN]) or "none"


def space_of(topic: str) -> str:
    """Namespace of a publisher: `robot1` of /robot1/tf_static."""
    return topic.strip("/").rpartition("/")[0]


def spaces_above(topic: str) -> list[str]:
    """Namespaces that a topic lies in, the innermost first, the global one last."""
    parts = topic.strip("/").split("/")[:-1]
    return ["/".join(parts[:k]) for k in range(len(parts), -1, -1)]


def agreed(chain: Chain, where: str) -> Chain:
    """The chain, whose every edge has one value. Raises LogError naming both values of one that has two."""
    for edge, _ in chain.steps:
        if edge.other is not None:
            names = f"{printable(edge.key.parent)} -> {printable(edge.key.child)}"
            raise LogError(
                f"{where}: {printable(edge.topic)} gives {names} twice and differently: {rigid.text(edge.motion)}, and"
                f" {rigid.text(edge.other)}; say which with --extrinsic"
                f" {printable(edge.key.parent)}:{printable(edge.key.child)}=x,y,z,roll,pitch,yaw"
            )
    return chain


def _walk(edges: list[Edge], source: str, target: str) -> list[tuple[Edge, bool]] | None:
    """Breadth first; None where there is no way."""
    if source == target:
        return []
    beside: dict[str, list[tuple[str, Edge, bool]]] = {}
    for edge in edges:
        beside.setdefault(edge.key.child, []).append((edge.key.parent, edge, False))
        beside.setdefault(edge.key.parent, []).append((edge.key.child, edge, True))
    came: dict[str, tuple[str, Edge, bool]] = {}
    waiting = deque([source])
    while waiting:
        at = waiting.popleft()
        for name, edge, down in beside.get(at, ()):
            if name == source or name in came:
                continue
            came[name] = (at, edge, down)
            if name == target:
                return list(reversed(list(_back(came, source, target))))
            waiting.append(name)
    return None


def _back(came: dict[str, tuple[str, Edge, bool]], source: str, target: str) -> Iterator[tuple[Edge, bool]]:
    at = target
    while at != source:
        at, edge, down = came[at]
        yield edge, down


def _branch(name: str, children: dict[str, list[Edge]], seen: set[str]) -> str:
    seen.add(name)
    parts = []
    for edge in children.get(name, [])[:_SHOWN]:
        if edge.key.child not in seen:
            moves = " (moves)" if edge.kind == MOVING else ""
            parts.append(_branch(edge.key.child, children, seen) + moves)
    inner = ", ".join(parts)
    if not parts:
        return printable(name)
    return f"{printable(name)} > {inner if len(parts) == 1 else '(' + inner + ')'}"
