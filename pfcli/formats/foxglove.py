"""Foxglove's schemas, in protobuf and JSON, as the ROS messages that say the same."""

from pfcli.formats.carried_types import Translate
from pfcli.formats.reader import Channel


def is_one(channel: Channel) -> bool:
    """Whether a channel has one of the schemas."""
    return False


def canonical(channel: Channel) -> tuple[Channel, Translate | None]:
    """The channel as pfcli reads it, and what its payloads must go through."""
    return channel, None
