"""ROS 1 and ROS 2 bags as MCAP logs, through rosbags."""

from pathlib import Path
from typing import Any

from pfcli.errors import LogError, OutputError, reason
from pfcli.formats.log_writer import LogWriter
from pfcli.formats.schemas import ros_types, typestore


def convert(source: Path, target: Path, compression: str) -> dict[str, int | str]:
    """Copy every message of a type that pfcli knows; counts of copied and left-out messages."""
    from rosbags.highlevel import AnyReader

    folder = source.parent if source.suffix == ".db3" else source
    known = set(ros_types())
    copied = skipped = 0
    try:
        with AnyReader([folder], default_typestore=typestore()) as reader, LogWriter(target, compression) as log:
            for connection, stamp_ns, raw in reader.messages():
                if connection.msgtype not in known:
                    skipped += 1
                    continue
                if source.suffix == ".bag":
                    message: Any = reader.deserialize(raw, connection.msgtype)
                    payload = bytes(typestore().serialize_cdr(_without_seq(message), connection.msgtype))
                else:
                    payload = bytes(raw)
                log.raw(connection.topic, connection.msgtype, stamp_ns, payload)
                copied += 1
    except (LogError, OutputError):
        raise
    except Exception as error:  # rosbags raises whatever its readers and generated code trip over
        raise LogError(f"{source}: cannot be read as a ROS bag ({reason(error)})") from None
    if copied == 0:
        raise LogError(f"{source}: holds no message of a type that pfcli reads; see `schemas/`")
    return {"out": str(target), "messages": copied, "skipped": skipped}


def _without_seq(message: Any) -> Any:
    """A ROS 1 message as its ROS 2 type: the same fields but for the header's `seq`."""
    name = getattr(type(message), "__msgtype__", None)
    if name is None:
        return [_without_seq(m) for m in message] if isinstance(message, list) else message
    target = typestore().types[name]
    values = [
        _without_seq(getattr(message, field)) for field in target.__dataclass_fields__ if not field.startswith("__")
    ]
    return target(*values)
