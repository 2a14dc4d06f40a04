"""Odometry and truth out of the transforms on /tf: `/tf:odom.base_link`, composed over whatever lies between the two frames."""

from collections.abc import Callable
from typing import Any, NamedTuple

from pfcli.core import rigid
from pfcli.events import Odometry, Truth
from pfcli.formats.messages import Decoder, Transform, transforms
from pfcli.replay.frames.transform_tree import CONSTANT, MOVING, Chain, Edge
from pfcli.replay.reorder import Stamp


class Pair(NamedTuple):
    """Frames whose relation is asked for: topic of the transforms, parent and child."""

    topic: str
    parent: str
    child: str


def pair_of(topic: str) -> Pair | None:
    """The pair that a topic such as /tf:odom.base_link, or /robot1/tf:odom.base_link, names; None for other topics."""
    name, colon, frames = topic.partition(":")
    if not colon or not name.strip("/").endswith("tf") or "." not in frames:
        return None
    parent, _, child = frames.partition(".")
    return Pair("/" + name.strip("/"), parent.lstrip("/"), child.lstrip("/"))


def carrier_of(chain: Chain) -> Edge | None:
    """The edge of a chain whose messages give the stamps: of those that move the one with the most messages; where the robot
    stands still for the whole log, of those that could."""
    still = [edge for edge, _ in chain.steps if edge.kind == CONSTANT]
    return max(chain.moving or still, key=lambda edge: edge.messages, default=None)


def reader_of(role: str, chain: Chain, carrier: Edge) -> tuple[Decoder, Stamp]:
    """Read the child of a chain in its parent, at every message of the carrier; the others are interpolated.

    chain: from the child to the parent.
    """
    kind = Truth if role == "truth" else Odometry
    at = next(k for k, (edge, _) in enumerate(chain.steps) if edge is carrier)
    before, after, down = Chain(chain.steps[:at]), Chain(chain.steps[at + 1 :]), chain.steps[at][1]
    alone = not before.steps and not after.steps and not down

    def stamp(payload: bytes) -> int | None:
        found = _find(payload, 0, len(payload), carrier)
        return None if found is None else found.stamp_ns

    def decode(buffer: Any, offset: int, length: int, stamp_ns: int) -> tuple[Any, str]:
        found = _find(buffer, offset, length, carrier)
        if found is None:
            raise KeyError
        step = rigid.from_quaternion(found.translation, found.rotation)
        if not alone:
            own_ns = found.stamp_ns
            step = after.at(own_ns) @ (rigid.inverse(step) if down else step) @ before.at(own_ns)
        return kind(stamp_ns, float(step[0, 3]), float(step[1, 3]), rigid.yaw_of(step)), ""

    return decode, stamp


def _find(buffer: Any, offset: int, length: int, edge: Edge) -> Transform | None:
    for t in transforms(buffer, offset, length):
        if t.parent.lstrip("/") == edge.key.parent and t.child.lstrip("/") == edge.key.child:
            return t
    return None


def proposals(edges: list[Edge], leads_to_base: Callable[[str], bool]) -> list[Edge]:
    """Moving edges that can be odometry: their child carries the base; a parent called odom first, no map or world."""
    moving = [e for e in edges if e.kind == MOVING and leads_to_base(e.key.child)]
    names = [e.key.parent.rpartition("/")[2] for e in moving]
    odometry = [e for e, name in zip(moving, names, strict=True) if "odom" in name]
    return odometry or [e for e, n in zip(moving, names, strict=True) if n not in ("map", "world", "earth")]


__all__ = ["Pair", "carrier_of", "pair_of", "proposals", "reader_of"]
