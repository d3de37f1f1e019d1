"""Claims on calls: of all processes that share a folder of replies, of whatever runs, one pays for a call at a time.

A claim is a lock on one byte of one file, at a place that the call's key gives: nothing is made or removed for it, and
it ends with its process, however that ends.
"""

from __future__ import annotations

import fcntl
import os
import struct
import threading
from pathlib import Path

from pipeline.models.file_log import NO_LOCKS

_FLOCK = "hhqqi4x"
"""C's `struct flock`: type, whence, start, length, process."""


class Claims:
    """The claims of this process. Threads may share it.

    Args:
        path: The file that is locked; made on first use.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._lock = path, threading.Lock()
        self._file: int | None = None

    def __del__(self) -> None:
        self.close()

    def take(self, key: str) -> bool:
        """Claim a key; return whether nobody else has. On a file system without locks nobody ever has.

        Raises:
            OSError: The file cannot be written.
        """
        with self._lock:
            if self._file is None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._file = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
            try:
                self._set(self._file, fcntl.F_WRLCK, key)
            except BlockingIOError:
                return False
            except OSError as error:
                if error.errno not in NO_LOCKS:
                    raise
            return True

    def free(self, key: str) -> None:
        """Give a claim up."""
        with self._lock:
            if self._file is not None:
                self._set(self._file, fcntl.F_UNLCK, key)

    def close(self) -> None:
        """Give up all."""
        with self._lock:
            file, self._file = self._file, None
            if file is not None:
                os.close(file)

    @staticmethod
    def _set(file: int, kind: int, key: str) -> None:
        # Locks of the open file, not of the process: those would be lost when any other file object on it is closed.
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, struct.pack(_FLOCK, kind, os.SEEK_SET, int(key[:15], 16), 1, 0))
