"""rosbag2's SQLite files (`.db3`), with or without the metadata beside them: topics and types stand in the file itself."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import numpy as np

from pfcli.errors import LogError, reason
from pfcli.formats.limits import AS_IT_IS, Reading
from pfcli.formats.reader import EVERYTHING, Batch, Channel, Span, Wanted
from pfcli.formats.schemas import declaration, ros_types

MAGIC = b"SQLite format 3\0"
_ROWS = 512
_KINDS = {"ros2msg": "ros2msg", "ros2idl": "ros2idl"}


class SqliteBag:
    """One file. Raises LogError where it is no bag."""

    def __init__(self, path: Path, reading: Reading = AS_IT_IS, shown: Path | None = None) -> None:
        self.path = shown or path
        self.channels: dict[int, Channel] = {}
        self.losses: list[str] = []
        self.missing = 0
        self._room = int(reading.max_chunk_mib * 2**20)
        # a recorder that was killed leaves its last messages in a write-ahead log beside the file
        pending = path.with_name(path.name + "-wal").exists()
        self._uri = f"file:{quote(str(path.absolute()))}?mode=ro" + ("" if pending else "&immutable=1")

    @property
    def files(self) -> list[Path]:
        """The file."""
        return [self.path]

    def survey(self) -> None:
        """Read the tables of topics and of definitions."""
        with self._opened() as base:
            try:
                topics = base.execute("SELECT id, name, type, serialization_format FROM topics ORDER BY id").fetchall()
            except sqlite3.Error as error:
                raise LogError(f"{self.path}: is no bag of rosbag2 ({reason(error)})") from None
            try:
                rows = base.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
                texts = {name: (_KINDS.get(kind, ""), text.encode()) for name, kind, text in rows}
            except (sqlite3.Error, AttributeError):
                texts = {}  # older bags have no such table
        known = set(ros_types())
        for ident, topic, name, encoding in topics:
            kind, text = texts.get(name, ("", b""))
            if not text and name in known:
                _, kind, text = declaration(name)
            self.channels[ident] = Channel(ident, str(topic), str(encoding), str(name), kind, text)

    def span(self) -> Span | None:
        """Times and count of the messages."""
        with self._opened() as base:
            try:
                first, last, count = base.execute(
                    "SELECT MIN(timestamp), MAX(timestamp), COUNT(*) FROM messages"
                ).fetchone()
            except sqlite3.Error:
                return None
        return Span(first, last, count) if count else None

    def batches(self, wanted: Wanted = EVERYTHING) -> Iterator[Batch]:
        """Messages in the order of the recorder's time."""
        self.losses.clear()
        where, values = ["timestamp BETWEEN ? AND ?"], [wanted.begin_ns, wanted.end_ns]
        if wanted.channels is not None:
            where.append(f"topic_id IN ({', '.join('?' * len(wanted.channels))})")
            values += sorted(wanted.channels)
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE {' AND '.join(where)} ORDER BY timestamp, id"
        with self._opened() as base:
            try:
                rows = base.execute(query, values)
                while some := self._some(rows):
                    yield _batch(some)
            except sqlite3.Error as error:
                self.losses.append(f"{self.path}: is damaged ({reason(error)}); what follows cannot be read")

    def _some(self, rows: sqlite3.Cursor) -> list[tuple[int, int, bytes]]:
        """The next rows, as many as a batch may hold."""
        found: list[tuple[int, int, bytes]] = []
        size = 0
        while len(found) < _ROWS and size < 1 << 22:
            row = rows.fetchone()
            if row is None:
                break
            if not isinstance(row[2], bytes) or len(row[2]) > self._room:
                continue
            found.append(row)
            size += len(row[2])
        return found

    def _opened(self) -> "_Connection":
        return _Connection(self._uri, self.path)


class _Connection:
    """A connection that is closed in the end."""

    def __init__(self, uri: str, path: Path) -> None:
        try:
            self._base = sqlite3.connect(uri, uri=True)
        except sqlite3.Error as error:
            raise LogError(f"{path}: cannot be read ({reason(error)})") from None

    def __enter__(self) -> sqlite3.Connection:
        return self._base

    def __exit__(self, *failure: object) -> None:
        self._base.close()


def _batch(rows: list[tuple[int, int, bytes]]) -> Batch:
    topics, stamps, payloads = zip(*rows, strict=True)
    length = np.array([len(payload) for payload in payloads], np.int64)
    offset = np.concatenate([[0], np.cumsum(length)[:-1]]).astype(np.int64)
    stamp = np.array(stamps, np.int64)
    zeros = np.zeros(len(rows), np.int64)
    return Batch(b"".join(payloads), np.array(topics, np.int64), stamp, stamp, zeros, offset, length)
