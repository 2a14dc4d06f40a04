"""Messages by the definition that a file carries, brought into the layout that pfcli knows: by name, field for field.

Fields that a newer or older definition lacks take their default, further ones are passed over. Where the layout is ours
already, nothing is done. ROS 1 serialisation becomes CDR.
"""

import re
from collections.abc import Callable
from typing import Any

import numpy as np

from pfcli.errors import reason
from pfcli.formats.reader import Channel
from pfcli.formats.schemas import declaration, is_known, ros2msg, typestore

Translate = Callable[[bytes], bytes]
"""Payload as the file has it -> payload as pfcli reads it. Raises ValueError."""

_RENAMED = {
    "tf/msg/tfMessage": "tf2_msgs/msg/TFMessage",
    "roslib/msg/Header": "std_msgs/msg/Header",
    "foxglove_msgs/msg/LaserScan": "sensor_msgs/msg/LaserScan",
}
_NEEDED = {
    "sensor_msgs/msg/LaserScan": ("header", "angle_min", "angle_increment", "ranges"),
    "nav_msgs/msg/Odometry": ("header", "pose"),
    "sensor_msgs/msg/JointState": ("header", "name"),
    "sensor_msgs/msg/Range": ("header", "range"),
    "sensor_msgs/msg/Imu": ("header", "angular_velocity"),
    "geometry_msgs/msg/PoseStamped": ("header", "pose"),
    "geometry_msgs/msg/TwistStamped": ("header", "twist"),
    "tf2_msgs/msg/TFMessage": ("transforms",),
}
"""Fields without which a message says nothing."""
_DDS = re.compile(r"(\w+)::(msg)::dds_::(\w+)_")
_SHORT = re.compile(r"(\w+)[/.](?:msg[/.])?(\w+)")
_CONSTANT = re.compile(r"^\s*\S+\s+\w+\s*=")


def type_name(name: str) -> str:
    """A ROS type as `package/msg/Type`, however a recorder writes it."""
    dds = _DDS.fullmatch(name)
    short = _SHORT.fullmatch(name) if not name.startswith(("pfcli.", "foxglove.")) else None
    found = f"{dds[1]}/msg/{dds[3]}" if dds else f"{short[1]}/msg/{short[2]}" if short else name
    return _RENAMED.get(found, found)


def canonical(channel: Channel) -> tuple[Channel, Translate | None]:
    """A ROS channel as pfcli reads it, and what its payloads must go through; None: nothing.

    Types that pfcli does not know are left as they are.
    """
    name = type_name(channel.schema_name)
    if channel.encoding not in ("cdr", "ros1", "") or not is_known(name):
        renamed = channel._replace(schema_name=name) if channel.encoding in ("cdr", "ros1", "") else channel
        return renamed, None
    encoding, kind, text = declaration(name)
    ours = channel._replace(schema_name=name, encoding=encoding, schema_encoding=kind, schema=text)
    if channel.encoding != "ros1":
        if _same_text(channel.schema.decode("utf-8", "replace"), name):
            return channel._replace(schema_name=name), None
        carried = _carried(channel, name)
        if carried is None or _same(carried, channel.schema_name, name):
            return channel._replace(schema_name=name), None
        return ours, _by_name(carried.deserialize_cdr, _full(channel.schema_name), name)
    carried = _carried(channel, name)
    if carried is None or _same(carried, channel.schema_name, name):
        return ours, lambda payload: _guarded(name, lambda: bytes(typestore().ros1_to_cdr(payload, name)))
    return ours, _by_name(carried.deserialize_ros1, _full(channel.schema_name), name)


def _full(name: str) -> str:
    """A carried type's own name as `package/msg/Type`."""
    short = _SHORT.fullmatch(name)
    dds = _DDS.fullmatch(name)
    return f"{dds[1]}/msg/{dds[3]}" if dds else f"{short[1]}/msg/{short[2]}" if short else name


def _fields_of(text: str) -> dict[str, list[tuple[str, ...]]]:
    """Type (without its package; '' is the first) -> its fields, as words."""
    found: dict[str, list[tuple[str, ...]]] = {}
    for k, part in enumerate(re.split(r"^=+$", text, flags=re.M)):
        lines = [line.split("#")[0].split() for line in part.splitlines() if not _CONSTANT.match(line)]
        lines = [words for words in lines if words]
        name = lines.pop(0)[-1].rpartition("/")[2] if k and lines and lines[0][0] == "MSG:" else ""
        found[name] = [(words[0].rpartition("/")[2], words[1]) for words in lines if len(words) > 1]
    return found


def _same_text(text: str, name: str) -> bool:
    """Whether a definition has the fields of ours, told without parsing; an empty one says nothing else."""
    theirs, ours = _fields_of(text), _fields_of(ros2msg(name))
    return not any(theirs.values()) or all(theirs.get(kind) == fields for kind, fields in ours.items())


def _carried(channel: Channel, name: str) -> Any:
    """A type system with what the file says of a type; None where it says nothing that can be understood."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    text = channel.schema.decode("utf-8", "replace")
    try:
        if channel.schema_encoding == "ros2idl":
            types = get_types_from_idl(text)
        else:
            types = get_types_from_msg(text, _full(channel.schema_name))
        default = get_typestore(Stores.ROS1_NOETIC if channel.encoding == "ros1" else Stores.ROS2_HUMBLE)
        missing = _named(types) - set(types)
        while missing:
            types |= {kind: default.fielddefs[kind] for kind in missing}
            missing = _named(types) - set(types)
        store = get_typestore(Stores.EMPTY)
        store.register(types)
    except Exception:  # the parsers of rosbags raise whatever they trip over; then the type's name must do
        return None
    return store if store.fielddefs[_full(channel.schema_name)][1] else None


def _named(types: Any) -> set[str]:
    """Types that the fields of types refer to."""
    found: set[str] = set()
    for _, fields in types.values():
        for _, kind in fields:
            _refer(kind, found)
    return found


def _refer(kind: Any, found: set[str]) -> None:
    node, value = kind
    if node.name == "NAME":
        found.add(value)
    elif node.name in ("ARRAY", "SEQUENCE"):
        _refer(value[0], found)


def _same(carried: Any, theirs: str, ours: str) -> bool:
    """Whether two types are laid out alike; the header of ROS 1 has one more field, which its serialisation accounts for."""
    mine, other = typestore().fielddefs[ours][1], carried.fielddefs[_full(theirs)][1]
    if ours == "std_msgs/msg/Header":
        other = [field for field in other if field[0] != "seq"]
    if [field for field, _ in mine] != [field for field, _ in other]:
        return False
    return all(_alike(carried, a, b) for (_, a), (_, b) in zip(other, mine, strict=True))


def _alike(carried: Any, theirs: Any, ours: Any) -> bool:
    if theirs[0].name != ours[0].name:
        return False
    if theirs[0].name == "BASE":
        return bool(theirs[1][0] == ours[1][0])
    if theirs[0].name == "NAME":
        return _same(carried, theirs[1], ours[1])
    return (theirs[0].name != "ARRAY" or theirs[1][1] == ours[1][1]) and _alike(carried, theirs[1][0], ours[1][0])


def _guarded(name: str, work: Callable[[], bytes]) -> bytes:
    try:
        return work()
    except Exception as error:  # the generated code of rosbags raises whatever it trips over
        raise ValueError(f"is not a {name} as the file defines it ({reason(error)})") from None


def _by_name(read: Any, theirs: str, ours: str) -> Translate:
    def translate(payload: bytes) -> bytes:
        return _guarded(ours, lambda: bytes(typestore().serialize_cdr(_rebuilt(read(payload, theirs), ours), ours)))

    return translate


def _rebuilt(message: Any, name: str) -> Any:
    """A message of another definition as the type `name`. Raises ValueError where a field that matters is not there."""
    values = []
    for field, kind in typestore().fielddefs[name][1]:
        if hasattr(message, field):
            values.append(_value(getattr(message, field), kind))
        elif field in _NEEDED.get(name, ()):
            raise ValueError(f"its definition has no field {field!r}")
        else:
            values.append(_default(kind))
    return typestore().types[name](*values)


def _value(value: Any, kind: Any) -> Any:
    node, inner = kind
    if node.name == "NAME":
        return _rebuilt(value, inner)
    if node.name == "BASE":
        return value
    if inner[0][0].name == "NAME":
        return [_rebuilt(item, inner[0][1]) for item in value]
    if inner[0][1][0] == "string":
        return list(value)
    found = np.asarray(value, inner[0][1][0].replace("octet", "uint8").replace("char", "uint8"))
    return np.resize(found, inner[1]) if node.name == "ARRAY" and found.size != inner[1] else found


def _default(kind: Any) -> Any:
    """The default of a field that a definition lacks."""
    node, inner = kind
    if node.name == "NAME":
        fields = typestore().fielddefs[inner][1]
        return typestore().types[inner](*(_default(each) for _, each in fields))
    if node.name == "BASE":
        return "" if inner[0] == "string" else False if inner[0] == "bool" else 0
    count = inner[1] if node.name == "ARRAY" else 0
    if inner[0][0].name == "NAME" or inner[0][1][0] == "string":
        return [_default(inner[0]) for _ in range(count)]
    return np.zeros(count, inner[0][1][0].replace("octet", "uint8").replace("char", "uint8"))
