"""Write MCAP logs as `ros2 bag record -s mcap` does: CDR messages with their ros2msg definitions, and JSON ones."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Self

from pfcli.formats.atomic import output_file
from pfcli.formats.message_writer import MessageWriter
from pfcli.formats.schemas import declaration

COMPRESSION = ("zstd", "lz4", "none")


@contextmanager
def mcap_writer(path: Path, compression: str = "zstd", profile: str = "ros2") -> Iterator[Any]:
    """The mcap package's writer; the file appears when the block ends without an error. Raises OutputError."""
    from mcap.writer import CompressionType, Writer

    kinds = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}
    with output_file(path) as partial, open(partial, "wb") as file:
        writer = Writer(file, compression=kinds[compression])
        writer.start(profile=profile, library="pfcli")
        yield writer
        writer.finish()


class LogWriter(MessageWriter):
    """Writes beside `path` and renames at the end, so that a killed run leaves no half log."""

    def __init__(self, path: Path, compression: str = "zstd") -> None:
        self._path, self._compression = path, compression
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._sequence: dict[str, int] = {}

    def __enter__(self) -> Self:
        self._stack = ExitStack()
        self._writer = self._stack.enter_context(mcap_writer(self._path, self._compression))
        return self

    def __exit__(self, *failure: Any) -> None:
        self._stack.__exit__(*failure)

    def raw(self, topic: str, schema: str, stamp_ns: int, payload: bytes, definition: str | None = None) -> None:
        """Append a payload whose encoding follows its type: `pfcli.*` is JSON, all else CDR."""
        if topic not in self._channels:
            encoding, kind, text = declaration(schema)
            if schema not in self._schemas:
                body = text if definition is None else definition.encode()
                self._schemas[schema] = self._writer.register_schema(schema, kind, body)
            self._channels[topic] = self._writer.register_channel(topic, encoding, self._schemas[schema])
        sequence = self._sequence.get(topic, 0)
        self._sequence[topic] = sequence + 1
        self._writer.add_message(self._channels[topic], stamp_ns, payload, stamp_ns, sequence)
