"""Logs of new files: many small files are made safe from a crash of the machine by one sync.

A file is written without a sync and its line appended to a log of the process, which is synced. Later the files
themselves are, and the log goes. A lock tells whose log is left: it ends with its process.
"""

from __future__ import annotations

import errno
import fcntl
import itertools
import os
import uuid
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

NO_LOCKS = frozenset({errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP})
"""What a file system without locks says."""


_OURS = uuid.uuid4().hex
"""Names of unfinished files: two processes that share a folder, on whatever machines, never write the same one."""
_numbers = itertools.count()


class FileLog:
    """Files that may not have reached the disk: a log that its process holds a lock on.

    Args:
        folder: Where logs lie; made where it is not there.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / f"{uuid.uuid4().hex}.jsonl"
        self.paths: list[Path] = []
        places = [folder] if folder.is_dir() else [folder, folder.parent, folder.parent.parent]
        folder.mkdir(parents=True, exist_ok=True)
        with alone(folder):  # between making and locking it nobody may think it left
            self._file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o666)
            fcntl.flock(self._file, fcntl.LOCK_EX)
        for place in places:
            _sync_one(place)

    def __del__(self) -> None:
        if hasattr(self, "_file"):
            os.close(self._file)

    def append(self, lines: Mapping[Path, bytes]) -> None:
        """Add files by their path, each of one line; on return they are safe."""
        content = memoryview(b"".join(line + b"\n" for line in lines.values()))
        while content:
            content = content[os.write(self._file, content) :]
        os.fsync(self._file)
        self.paths.extend(lines)


def write_unsynced(path: Path, content: bytes) -> None:
    """Write a file so that a reader sees all of it or nothing; it may be lost with the machine."""
    # Plain calls rather than those of `Path`, which take longer than the disk does.
    folder, name = os.path.split(path)
    temporary = f"{folder}/.{name}.{_OURS}-{os.getpid()}-{next(_numbers)}.tmp"
    try:
        try:
            _write(temporary, content)
        except FileNotFoundError:
            os.makedirs(folder, exist_ok=True)
            _write(temporary, content)
        os.replace(temporary, path)
    except BaseException:
        with suppress(FileNotFoundError):
            os.unlink(temporary)
        raise


def _write(path: str, content: bytes) -> None:
    with open(path, "wb", buffering=0) as file:
        if file.write(content) < len(content):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def settle(log: FileLog) -> None:
    """Sync the files of a log of this process, and drop it."""
    sync(log.paths)
    log.path.unlink(missing_ok=True)


def sync(paths: Collection[Path]) -> None:
    """Bring files and their folders to the disk; what somebody removed is passed over."""
    folders = {path.parent for path in paths}
    for place in [*dict.fromkeys(paths), *folders, *{folder.parent for folder in folders}]:
        with suppress(FileNotFoundError):
            _sync_one(place)


def _sync_one(place: Path) -> None:
    opened = os.open(place, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


@contextmanager
def alone(logs: Path) -> Iterator[None]:
    """Hold a folder of logs: others that make one or look for those left wait."""
    opened = os.open(logs / "lock", os.O_RDWR | os.O_CREAT, 0o666)
    try:
        fcntl.flock(opened, fcntl.LOCK_EX)
        yield
    finally:
        os.close(opened)
