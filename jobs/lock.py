"""One driver a run folder: a small file with the driver's process and a heartbeat.

A lock counts as abandoned when its process on this machine is gone, or when a driver elsewhere has not shown a
heartbeat for a while. Between looking and taking over there is a moment in which two drivers could both take an
abandoned lock; parts are named by content, so even then no row is lost or doubled.
"""

from __future__ import annotations

import json
import os
import socket
import threading
import time
import uuid
from pathlib import Path
from types import TracebackType
from typing import Any

from schemas import storage
from schemas.errors import InputError, StopError

LOCK_FILE = "lock.json"
BEAT_S = 5.0
"""Seconds between heartbeats."""
ABANDONED_S = 60.0
"""Silence after which a driver on another machine counts as gone: many beats, so a slow disk does not look dead."""


class RunLock:
    """Holds a run folder for this process, as a context manager.

    Args:
        run: Run folder.

    Raises:
        StopError: On entry: another driver is at work.
    """

    def __init__(self, run: str) -> None:
        self._uri = storage.join(run, LOCK_FILE)
        self._owner = uuid.uuid4().hex
        self._ended = threading.Event()
        self._beat = threading.Thread(target=self._keep_beating, name="run-lock", daemon=True)

    def __enter__(self) -> RunLock:
        path = storage.local_path(self._uri)
        present = storage.exists(self._uri)
        holder = read_lock(self._uri)
        if holder is not None and _alive(holder):
            raise StopError(
                f"{self._uri}: another driver is at work on this run (process {holder.get('pid')} on "
                f"{holder.get('host')}); stop it first"
            )
        if path is None or present:
            storage.write_bytes_atomic(self._uri, self._content())
        else:
            self._create(path)
        self._beat.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._ended.set()
        self._beat.join()
        path = storage.local_path(self._uri)
        if path is not None and self._ours():
            path.unlink(missing_ok=True)

    def _create(self, path: Path) -> None:
        """Put the whole lock in place where there is none; of two drivers at once, one succeeds."""
        aside = path.with_name(f".{path.name}.{self._owner}.tmp")
        path.parent.mkdir(parents=True, exist_ok=True)
        aside.write_bytes(self._content())
        try:
            os.link(aside, path)
        except FileExistsError as error:
            raise StopError(f"{self._uri}: another driver began at the same moment; try again") from error
        finally:
            aside.unlink()

    def _keep_beating(self) -> None:
        while not self._ended.wait(BEAT_S):
            if self._ours():
                storage.write_bytes_atomic(self._uri, self._content())

    def _ours(self) -> bool:
        holder = read_lock(self._uri)
        return holder is not None and holder.get("owner") == self._owner

    def _content(self) -> bytes:
        holder = {
            "owner": self._owner,
            "host": socket.gethostname(),
            "pid": os.getpid(),
            "started": _process_start(os.getpid()),
            "beat": time.time(),
        }
        return json.dumps(holder).encode()


def read_lock(uri: str) -> dict[str, Any] | None:
    """Return who holds a lock file; None when nobody does or the file says nothing."""
    try:
        found = json.loads(storage.read_bytes(uri)) if storage.exists(uri) else None
    except (InputError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def driver_alive(run: str) -> bool:
    """Return whether a driver is at work on a run."""
    holder = read_lock(storage.join(run, LOCK_FILE))
    return holder is not None and _alive(holder)


def _alive(holder: dict[str, Any]) -> bool:
    if holder.get("host") != socket.gethostname():
        beat = holder.get("beat")
        return isinstance(beat, int | float) and time.time() - beat < ABANDONED_S
    pid = holder.get("pid")
    if not isinstance(pid, int) or pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return _process_start(pid) == holder.get("started")


def _process_start(pid: int) -> str:
    """Return when a process began, in the kernel's ticks: ids are used again, start times are not."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return ""
    state, *rest = text.rpartition(")")[2].split()
    # A killed process stays as a zombie until its parent looks; it does no more work.
    return "" if state == "Z" else rest[18]
