"""Which files make a recording: one file, several, the pattern of their names, a rosbag2 folder or another folder of parts."""

import glob
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pfcli.errors import LogError, printable
from pfcli.formats import text_files

_ENDINGS = (".mcap", ".db3", ".bag", ".mcap.zstd", ".db3.zstd")
_PART = re.compile(r"(.+)_(\d{1,6})")
_METADATA = "metadata.yaml"


class Found(NamedTuple):
    """path: what the recording is called; files: of its parts; in_order: somebody knows that this is their order;
    missing: sentences on parts that are not there."""

    path: Path
    files: list[Path]
    in_order: bool = True
    missing: tuple[str, ...] = ()


def find(paths: Sequence[Path]) -> Found:
    """The files of one recording. Raises LogError where there is none, or more than one."""
    found = [_found(path) for path in paths]
    if len(found) == 1:
        return found[0]
    files = list(dict.fromkeys(file for each in found for file in each.files))
    missing = tuple(note for each in found for note in each.missing) + _skipped(files)
    return Found(found[0].path, files, in_order=False, missing=missing)


def _found(path: Path) -> Found:
    if path.is_dir():
        return _folder(path)
    if path.exists() or not glob.has_magic(str(path)):
        return Found(path, [path])
    files = sorted((Path(name) for name in glob.glob(str(path))), key=natural)
    if not files:
        raise LogError(f"{path}: no file is called so")
    return find(files)._replace(path=files[0]) if len(files) > 1 else _found(files[0])


def natural(path: Path) -> tuple[Any, ...]:
    """Sort key of names: numbers in them count as numbers."""
    return tuple((int(word), "") if word.isdigit() else (-1, word) for word in re.split(r"(\d+)", path.name))


def stem(path: Path) -> str:
    """A file's name without the ending of its container."""
    return next((path.name.removesuffix(e) for e in (*_ENDINGS[3:], *_ENDINGS[:3]) if path.name.endswith(e)), path.name)


def _folder(folder: Path) -> Found:
    if (folder / _METADATA).is_file():
        return _described(folder)
    try:
        inside = sorted(folder.iterdir(), key=natural)
    except OSError as error:
        raise LogError(f"{folder}: cannot be read ({error.strerror})") from None
    files = [path for path in inside if path.name.endswith(_ENDINGS) and path.is_file()]
    bags = [path for path in inside if (path / _METADATA).is_file()]
    if not files and not bags:
        return Found(folder, [folder])  # a folder that is a log of its own, or none
    recordings: dict[str, list[Path]] = {}
    for path in files:
        part = _PART.fullmatch(stem(path))
        recordings.setdefault(part[1] if part else stem(path), []).append(path)
    names = [f"{name} ({len(parts)} parts)" if len(parts) > 1 else parts[0].name for name, parts in recordings.items()]
    names += [f"{bag.name}/" for bag in bags]
    if len(names) > 1:
        raise LogError(f"{folder}: holds {len(names)} recordings: {printable(', '.join(names))}; name one of them")
    if bags:
        return _described(bags[0])
    return Found(folder, files, in_order=len(files) == 1, missing=_skipped(files))


def _described(folder: Path) -> Found:
    """A folder that rosbag2 wrote. Its metadata know the parts and their order; the parts may have been moved with it."""
    path = folder / _METADATA
    try:
        table = (text_files.mapping(path, "the metadata of a bag") or {})["rosbag2_bagfile_information"]
        names = [str(name) for name in table["relative_file_paths"]]
        about = {str(row["path"]): row for row in table.get("files") or []}
    except (KeyError, TypeError):
        names = []
    if not names:
        raise LogError(f"{path}: names no parts (field 'relative_file_paths'); give the files of {folder} themselves")
    files, missing = [], []
    for name in names:
        places = [folder / name, folder / Path(name).name, folder / f"{Path(name).name}.zstd"]
        here = next((place for place in places if place.is_file()), None)
        if here is not None:
            files.append(here)
        else:
            missing.append(f"{path}: names {printable(name)}, which is not there{_holding(about.get(name))}")
    if not files:
        raise LogError(f"{path}: names {printable(', '.join(names))}, and none of them is there")
    return Found(folder, files, missing=tuple(missing))


def _holding(row: Any) -> str:
    """What the metadata say of a part."""
    try:
        return f": {row['message_count']} messages of {row['duration']['nanoseconds'] * 1e-9:.1f} s are missing"
    except (KeyError, TypeError):
        return ""


def _skipped(files: list[Path]) -> tuple[str, ...]:
    """Numbers that are missing between those of the parts' names."""
    numbers: dict[tuple[Path, str], set[int]] = {}
    for path in files:
        part = _PART.fullmatch(stem(path))
        if part:
            numbers.setdefault((path.parent, part[1]), set()).add(int(part[2]))
    notes = []
    for (folder, name), have in numbers.items():
        lost = sorted(set(range(min(have), max(have))) - have)
        if lost and len(lost) <= max(have):
            which = ", ".join(f"{name}_{k}" for k in lost[:5]) + (", ..." if len(lost) > 5 else "")
            notes.append(
                f"{folder}: holds parts {min(have)} to {max(have)} of {printable(name)}, but not {printable(which)}"
            )
    return tuple(notes)
