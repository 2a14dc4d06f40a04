"""The message definitions of `schemas/`, in a checkout and in an installed wheel."""

import functools
from pathlib import Path
from typing import Any

_PACKAGE = Path(__file__).resolve().parents[1]


def folder() -> Path:
    """Where the schema files lie."""
    shipped = _PACKAGE / "schemas"
    return shipped if shipped.is_dir() else _PACKAGE.parent / "schemas"


def ros2msg(name: str) -> str:
    """Full ROS 2 definition of `package/msg/Type`."""
    return (folder() / (name.replace("/msg/", ".") + ".msg")).read_text()


def json_schema(name: str) -> str:
    """JSON Schema of a `pfcli.Type` message."""
    return (folder() / f"{name}.json").read_text()


def declaration(name: str) -> tuple[str, str, bytes]:
    """How a channel of a type with a definition here is declared: encoding of its messages, of the schema, and its text."""
    if name.startswith("pfcli."):
        return "json", "jsonschema", json_schema(name).encode()
    return "cdr", "ros2msg", ros2msg(name).encode()


def ros_types() -> list[str]:
    """Every ROS 2 type with a definition here, as `package/msg/Type`."""
    return sorted(path.stem.replace(".", "/msg/", 1) for path in folder().glob("*.msg"))


def is_known(name: str) -> bool:
    """Whether messages of a type are read: it has a definition here."""
    return name in _known()


@functools.cache
def _known() -> frozenset[str]:
    return frozenset((*ros_types(), *(path.stem for path in folder().glob("pfcli.*.json"))))


@functools.cache
def typestore() -> Any:
    """rosbags' type system with every type of `schemas/` registered."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for name in ros_types():
        parts = ros2msg(name).split("=" * 80)
        for k, part in enumerate(parts):
            body = part.strip("\n")
            if k == 0:
                full = name
            else:
                head, _, body = body.partition("\n")
                full = head.removeprefix("MSG: ").replace("/", "/msg/", 1)
            if full not in store.types:
                store.register(get_types_from_msg(body, full))
    return store
