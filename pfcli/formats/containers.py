"""Which container a file is, by what it holds, and its reader."""

from pathlib import Path

from pfcli.formats.limits import Reading
from pfcli.formats.mcap_file import McapFile
from pfcli.formats.reader import Reader


def open_part(path: Path, reading: Reading) -> Reader:
    """The reader of one file, or of a folder that is one log. Raises LogError."""
    return McapFile(path, reading.max_chunk_mib)
