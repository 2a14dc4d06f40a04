"""The output directory: written beside its place and renamed in one step, so that a killed run leaves no half result."""

import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pfcli.errors import OutputError, UsageError, reason


@contextmanager
def output_dir(target: Path, *, force: bool) -> Iterator[Path]:
    """Folder to write into; becomes `target` when the block ends without an error.

    Raises OutputError where `target` is not empty (unless `force`), not writable, or the disk is full.
    """
    check(target, force=force)
    partial = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        partial.mkdir()
    except OSError as error:
        raise OutputError(f"{target}: cannot be made ({reason(error)})") from None
    try:
        yield partial
        _replace(partial, target)
    except OSError as error:
        raise OutputError(f"{target}: cannot be written ({reason(error)}); nothing was kept") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def check(target: Path, *, force: bool) -> None:
    """Refuse a target early, before an hour of work."""
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise OutputError(f"{target}: is not a folder; choose another --out")
    try:
        if target.is_dir() and any(target.iterdir()) and not force:
            raise OutputError(f"{target}: is not empty; choose another --out or say --force")
    except OSError as error:
        raise OutputError(f"{target}: cannot be read ({reason(error)})") from None
    above = target.absolute()
    while not above.exists():
        above = above.parent
    if not os.access(above, os.W_OK | os.X_OK):
        raise OutputError(f"{target}: {above} is not writable")


PICTURES = (".png", ".svg", ".pdf")


def check_kind(picture: Path) -> None:
    """Refuse a picture of a kind that cannot be drawn."""
    if picture.suffix not in PICTURES:
        raise UsageError(f"--plot {picture}: the ending must be one of {', '.join(PICTURES)}")


def _replace(partial: Path, target: Path) -> None:
    old = None
    if target.exists():
        old = target.with_name(f".{target.name}.{os.getpid()}.old")
        os.rename(target, old)
    os.rename(partial, target)
    if old is not None:
        shutil.rmtree(old, ignore_errors=True)


def interrupt_on_terminate() -> None:
    """Treat SIGTERM as Ctrl-C, so that a stopped job cleans up after itself."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
