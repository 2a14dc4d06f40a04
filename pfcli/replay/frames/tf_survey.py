"""Transforms of a recording's files, read into its tree."""

from collections.abc import Iterable, Iterator
from typing import Protocol

import numpy as np

from pfcli.formats.messages import Transform, transforms
from pfcli.formats.reader import Batch, Channel, Wanted
from pfcli.replay.frames.transform_tree import CONSTANT, MOVING, STATIC, Edge, Key, Tree, space_of

TF = "tf2_msgs/msg/TFMessage"


class File(Protocol):
    """What is asked of a recording: its channels by id, and its messages in batches."""

    channels: dict[int, Channel]

    def batches(self, wanted: Wanted = ...) -> Iterable[Batch]:
        """Messages in the order of the file."""
        ...


def is_static(topic: str) -> bool:
    """Whether a topic latches transforms that hold for the whole recording."""
    return topic.endswith("tf_static")


def survey(tree: Tree, file: File, topics: dict[int, str]) -> None:
    """Take up every transform of the channels `topics` (id -> topic): static ones, and whether the others move."""
    for topic, found in _all(file, topics):
        kind = STATIC if is_static(topic) else CONSTANT
        for t in found:
            key = Key(space_of(topic), t.parent.lstrip("/"), t.child.lstrip("/"))
            known = tree.edges.get(key)
            if known is not None and known.kind == MOVING:
                known.messages += 1
                continue
            tree.add(topic, t.parent, t.child, (*t.translation, *t.rotation), kind)


def collect(edges: Iterable[Edge], file: File, topics: dict[int, str]) -> None:
    """Fill the moving edges with their values by time."""
    wanted = {(edge.topic, edge.key.parent, edge.key.child): edge for edge in edges if not edge.stamps}
    if not wanted:
        return
    for topic, found in _all(file, topics):
        for t in found:
            edge = wanted.get((topic, t.parent.lstrip("/"), t.child.lstrip("/")))
            if edge is not None:
                edge.collect(t.stamp_ns, (*t.translation, *t.rotation))


def _all(file: File, topics: dict[int, str]) -> Iterator[tuple[str, list[Transform]]]:
    ids = list(topics)
    for batch in file.batches(Wanted(frozenset(ids))):
        for k in np.flatnonzero(np.isin(batch.channel, ids)).tolist():
            yield topics[int(batch.channel[k])], transforms(batch.data, int(batch.offset[k]), int(batch.length[k]))
