"""Output files and folders: written beside their place and renamed in one step, so that a killed run leaves no half result."""

import glob
import os
import platform
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pfcli.errors import OutputError, UsageError, reason


@contextmanager
def output_dir(target: Path, *, force: bool) -> Iterator[Path]:
    """Folder to write into; becomes `target` when the block ends without an error.

    Raises OutputError where `target` is not empty (unless `force`), not writable, or the disk is full.
    """
    _check_folder(target, force=force)
    partial = _beside(target, "part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        partial.mkdir()
    except OSError as error:
        raise OutputError(f"{target}: cannot be made ({reason(error)})") from None
    try:
        yield partial
        for path in partial.rglob("*"):
            if path.is_file():
                _sync(path)
        _replace(partial, target)
    except OSError as error:
        raise OutputError(f"{target}: cannot be written ({reason(error)}); nothing was kept") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def check_file(target: Path, *, force: bool) -> None:
    """Refuse a file early that could not be written in the end; `force`: it may be there already. Sweeps up after killed runs."""
    _tidy(target)
    _check_file(target, force=force)


def _check_file(target: Path, *, force: bool) -> None:
    if target.is_symlink() or (target.exists() and not target.is_file()):
        kind = "link" if target.is_symlink() else "folder" if target.is_dir() else "device"
        raise OutputError(f"{target}: is a {kind}; name a file")
    if target.exists() and not force:
        raise UsageError(f"{target}: exists; say --force to replace it")
    _check_above(target)


@contextmanager
def output_file(target: Path) -> Iterator[Path]:
    """File to write; becomes `target` when the block ends without an error.

    Raises OutputError where it cannot be written. A link is refused: what it points to was not named.
    """
    _check_file(target, force=True)
    partial = _beside(target, "part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        _sync(partial)
        os.replace(partial, target)
    except OSError as error:
        raise OutputError(f"{target}: cannot be written ({reason(error)})") from None
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def _beside(target: Path, kind: str) -> Path:
    """A name for what this process keeps beside an output while it writes it."""
    return target.with_name(f".{target.name}.{platform.node()}-{os.getpid()}.{kind}{target.suffix}")


def _tidy(target: Path) -> None:
    """Remove what killed processes of this machine left beside an output; what one had moved aside takes its place again."""
    begin = f".{target.name}.{platform.node()}-"
    for left in target.parent.glob(glob.escape(begin) + "*"):
        pid, _, kind = left.name.removeprefix(begin).partition(".")
        if not pid.isdigit() or _alive(int(pid)):
            continue
        with suppress(OSError):
            if kind.startswith("old") and not target.exists():
                os.rename(left, target)
            elif left.is_dir():
                shutil.rmtree(left)
            else:
                left.unlink()


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _sync(path: Path) -> None:
    """A name must not reach the disk before the bytes that it stands for."""
    with open(path, "rb+") as file:
        os.fsync(file.fileno())


def check(target: Path, *, force: bool) -> None:
    """Refuse a folder early, before an hour of work. Sweeps up after killed runs."""
    _tidy(target)
    _check_folder(target, force=force)


def _check_folder(target: Path, *, force: bool) -> None:
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise OutputError(f"{target}: is not a folder; choose another --out")
    try:
        if target.is_dir() and any(target.iterdir()) and not force:
            raise OutputError(f"{target}: is not empty; choose another --out or say --force")
    except OSError as error:
        raise OutputError(f"{target}: cannot be read ({reason(error)})") from None
    _check_above(target)


def _check_above(target: Path) -> None:
    """Folders that are not there yet are made; the first that is there must let us."""
    above = target.absolute().parent
    while not above.exists():
        above = above.parent
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        raise OutputError(f"{target}: {above} is not writable")


PICTURES = (".png", ".svg", ".pdf")


def check_picture(picture: Path) -> None:
    """Refuse a picture that cannot be drawn or written."""
    if picture.suffix not in PICTURES:
        raise UsageError(f"--plot {picture}: the ending must be one of {', '.join(PICTURES)}")
    check_file(picture, force=True)


def _replace(partial: Path, target: Path) -> None:
    old = None
    if target.exists():
        old = _beside(target, "old")
        os.rename(target, old)
    os.rename(partial, target)
    if old is not None:
        shutil.rmtree(old, ignore_errors=True)


def interrupt_on_terminate() -> None:
    """Treat SIGTERM as Ctrl-C, so that a stopped job cleans up after itself."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
