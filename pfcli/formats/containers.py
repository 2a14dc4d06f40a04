"""Which container a file is, by what it holds, and its reader."""

import atexit
import bz2
import gzip
import lzma
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pfcli.errors import LogError, reason
from pfcli.formats import landmark_logs, mcap_records, rawlog, ros1_bag, sqlite_bag, text_logs, tick_logs
from pfcli.formats.folders import find
from pfcli.formats.limits import Reading
from pfcli.formats.mcap_file import McapFile
from pfcli.formats.reader import Reader
from pfcli.formats.ros1_bag import Ros1Bag
from pfcli.formats.sqlite_bag import SqliteBag

_HEAD = 16
_UNPACK: dict[bytes, Callable[[Path], Any]] = {
    b"\x28\xb5\x2f\xfd": lambda path: _zstd(path),
    b"\x04\x22\x4d\x18": lambda path: _lz4(path),
    b"\x1f\x8b": gzip.open,
    b"BZh": bz2.open,
    b"\xfd7zXZ": lzma.open,
}
"""First bytes of a file that is compressed as a whole -> what opens it."""


def open_part(path: Path, reading: Reading) -> Reader:
    """The reader of one file, or of a folder that is one log. Raises LogError: it cannot be read, or nobody knows it."""
    if path.is_dir():
        found = text_logs.open_text(path, reading)
        if found is None:
            raise text_logs.refuse(path)
        return found
    head = _begin(path, open(path, "rb") if path.exists() else None)
    opened = _binary(path, head, reading)
    if opened is not None:
        return opened
    if rawlog.is_one(head):
        return rawlog.read(path, reading)
    unpack = next((opener for magic, opener in _UNPACK.items() if head.startswith(magic)), None)
    if unpack is not None:
        inside = _begin(path, unpack(path))
        if _is_binary(inside):
            return _unpacked(path, unpack, reading)
        if rawlog.is_one(inside):
            return rawlog.read(path, reading)
    text = text_logs.open_text(path, reading)
    if text is None:
        raise text_logs.refuse(path)
    return text


def inputs_of(paths: Sequence[Path]) -> list[Path]:
    """The files that a recording is read from, without reading them."""
    return [file for path in find(paths).files for file in _files(path)]


def _files(path: Path) -> tuple[Path, ...]:
    if landmark_logs.reader_of(path) is not None:
        return landmark_logs.files_of(path)
    return tick_logs.files_of(path)


def _begin(path: Path, file: Any) -> bytes:
    """The first bytes of a file. Raises LogError."""
    try:
        if file is None:
            raise FileNotFoundError(2, "No such file or directory")
        with file:
            head = bytes(file.read(_HEAD))
    except Exception as error:  # decompressors raise errors of their own
        raise LogError(f"{path}: cannot be read ({reason(error)})") from None
    if not head:
        raise LogError(f"{path}: is empty; nothing was recorded")
    return head


def _is_binary(head: bytes) -> bool:
    return head.startswith((mcap_records.MAGIC, b"#ROSBAG V", sqlite_bag.MAGIC))


def _binary(path: Path, head: bytes, reading: Reading, shown: Path | None = None) -> Reader | None:
    """The reader of a bag; None where it is none."""
    if head.startswith(mcap_records.MAGIC):
        return McapFile(path, reading.max_chunk_mib, shown)
    if head.startswith(ros1_bag.MAGIC):
        return Ros1Bag(path, reading, shown)
    if head.startswith(sqlite_bag.MAGIC):
        return SqliteBag(path, reading, shown)
    if head.startswith(b"#ROSBAG V"):
        raise LogError(
            f"{shown or path}: is a bag of version {head[9:12].decode('ascii', 'replace')}; `rosbag fix` makes 2.0"
        )
    return None


def _unpacked(path: Path, unpack: Callable[[Path], Any], reading: Reading) -> Reader:
    """The reader of a bag that is compressed as a whole: it is kept unpacked for as long as the command runs."""
    folder = Path(tempfile.mkdtemp(prefix="pfcli-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    copy = folder / path.stem
    try:
        with unpack(path) as data, open(copy, "wb") as out:
            shutil.copyfileobj(data, out, 1 << 20)
    except Exception as error:  # decompressors raise errors of their own; what they gave is still read
        cut = f"{path}: cannot be decompressed whole ({reason(error)}); what it holds up to there is used"
    else:
        cut = ""
    found = _binary(copy, _begin(path, open(copy, "rb")), reading, path)
    if found is None:
        raise text_logs.refuse(path)
    return _Cut(found, cut) if cut else found


class _Cut:
    """A reader of what a damaged file still gave."""

    def __init__(self, inner: Reader, cut: str) -> None:
        self.path, self.channels = inner.path, inner.channels
        self.files, self.survey, self.span, self.batches = inner.files, inner.survey, inner.span, inner.batches
        self._inner, self._cut = inner, cut

    @property
    def losses(self) -> list[str]:
        return [self._cut, *self._inner.losses]

    @property
    def missing(self) -> int:
        return self._inner.missing


def _zstd(path: Path) -> Any:
    import zstandard

    return zstandard.ZstdDecompressor().stream_reader(open(path, "rb"), read_across_frames=True)


def _lz4(path: Path) -> Any:
    import lz4.frame

    return lz4.frame.open(path)
