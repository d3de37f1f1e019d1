"""Files of this machine: written whole, durable before they count, and put where nothing lies by one writer only.

Every touch of the disk goes through `DISK`, so that tests can put a simulated one in its place, which loses power
between any two touches.
"""

from __future__ import annotations

import contextlib
import errno
import os
import uuid
from pathlib import Path

NO_LINKS = frozenset({errno.EPERM, errno.EOPNOTSUPP, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK})
"""What a file system without hard links answers."""


class Disk:
    """The touches of a disk. What was not synced may be lost, wholly or in part, when the power goes."""

    def read(self, path: Path) -> bytes:
        """Return a file's content."""
        return path.read_bytes()

    def exists(self, path: Path) -> bool:
        """Return whether a file or folder is there."""
        return path.exists()

    def files(self, folder: Path, recursive: bool) -> list[str]:
        """Return the names of the files in a folder, relative to it; none where it is missing."""
        found = folder.rglob("*") if recursive else folder.glob("*")
        return [path.relative_to(folder).as_posix() for path in found if path.is_file()]

    def make_folder(self, path: Path) -> None:
        """Make one folder in an existing one; nothing happens where it is there."""
        path.mkdir(exist_ok=True)

    def write(self, path: Path, data: bytes) -> None:
        """Write a file; readers may see any part of it meanwhile."""
        path.write_bytes(data)

    def sync(self, path: Path) -> None:
        """Make a file's content, or a folder's entries, outlast a power cut."""
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

    def replace(self, path: Path, target: Path) -> None:
        """Rename a file, in place of what is there."""
        path.replace(target)

    def link(self, path: Path, target: Path) -> None:
        """Give a file a second name; FileExistsError where that name is taken."""
        os.link(path, target)

    def unlink(self, path: Path) -> None:
        """Remove a name; nothing happens where there is none."""
        path.unlink(missing_ok=True)


DISK = Disk()

_settled: set[Path] = set()
"""Folders whose own entries this process has made durable."""


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that a reader, or whoever comes after a power cut, finds the old content or the new."""
    aside = _aside(path, data)
    try:
        DISK.replace(aside, path)
    except BaseException:
        DISK.unlink(aside)
        raise
    DISK.sync(path.parent)


def create(path: Path, data: bytes) -> bool:
    """Put a file where nothing lies; of several writers at once exactly one does.

    Returns:
        True when this content lies there now, durably: we put it there, or the very same bytes were there already.
        False when something else was there first; it is left as it is, and durable too.
    """
    aside = _aside(path, data)
    try:
        DISK.link(aside, path)
        ours = True
    except FileExistsError:
        # A network file system that lost its answer asks twice, and meets its own first try.
        ours = _holds(path, data)
    finally:
        DISK.unlink(aside)
    DISK.sync(path.parent)
    return ours


def _holds(path: Path, data: bytes) -> bool:
    try:
        return DISK.read(path) == data
    except FileNotFoundError:
        return False


def _aside(path: Path, data: bytes) -> Path:
    """Write the content, durably, to a file of its own beside `path`."""
    _settle(path.parent)
    aside = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    try:
        DISK.write(aside, data)
        DISK.sync(aside)
    except BaseException:
        DISK.unlink(aside)
        raise
    return aside


def _settle(folder: Path) -> None:
    """Make a folder and those above it, where missing, and their entries durable: once a process and folder."""
    folder = folder.absolute()
    if not DISK.exists(folder):
        _settle(folder.parent)
        DISK.make_folder(folder)
        _settled.discard(folder)
    if folder in _settled or folder.parent == folder:
        return
    _settle(folder.parent)
    with contextlib.suppress(PermissionError):  # a folder of somebody else's was there before us
        DISK.sync(folder.parent)
    _settled.add(folder)
