"""The run's diary, events.jsonl: one JSON object a line, appended as things happen. No result depends on it."""

from __future__ import annotations

import json
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from schemas import storage
from schemas.errors import SplatReasonerError

EVENTS_FILE = "events.jsonl"

FLUSH_S = 30.0
"""Seconds between files on an object store: a live view lags that much, and a day of work makes under 3,000 files."""


class EventLog:
    """Appends events of one driver.

    On an object store, which cannot append, the lines of some time go into a file of their own.

    Args:
        run: Run folder.
        clock: Seconds that only grow.
    """

    def __init__(self, run: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._run, self._kept, self._clock = run, list[str](), clock
        self._path = storage.local_path(storage.join(run, EVENTS_FILE))
        self._written = clock()
        self._whole = False

    def note(self, kind: str, **details: Any) -> None:
        """Append an event of a kind, with its details."""
        self._kept.append(json.dumps({"time": _now(), "event": kind, **details}, ensure_ascii=False) + "\n")
        if self._path is not None or self._clock() - self._written >= FLUSH_S:
            self.close()

    def close(self) -> None:
        """Write what was kept."""
        self._written = self._clock()
        if not self._kept:
            return
        text = "".join(self._kept).encode("utf-8", "replace")
        # A diary that cannot be written, on a full disk for one, ends no run: its lines wait for the next time.
        with suppress(OSError, SplatReasonerError):
            if self._path is None:
                moment = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
                name = f"events-{moment}-{uuid.uuid4().hex[:8]}.jsonl"
                storage.write_bytes_atomic(storage.join(self._run, name), text)
            else:
                self._append(self._path, text)
            self._kept = []

    def _append(self, path: Path, text: bytes) -> None:
        # A line that a crash or a full disk cut short must not swallow the next one.
        start, self._whole = b"" if self._whole else b"\n", False
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab") as stream:
            stream.write(start + text if stream.tell() else text)
        self._whole = True


def read_events(run: str) -> Iterator[dict[str, Any]]:
    """Yield a run's events; a line cut short by a crash is passed over, as the diary is no result."""
    path = storage.local_path(storage.join(run, EVENTS_FILE))
    if path is not None:
        if path.exists():
            with path.open(encoding="utf-8", errors="replace") as lines:
                yield from _events(lines)
        return
    for name in storage.list_files(run):
        if name.startswith("events-") and name.endswith(".jsonl"):
            text = storage.read_bytes(storage.join(run, name)).decode(errors="replace")
            yield from _events(text.split("\n"))


def _events(lines: Iterable[str]) -> Iterator[dict[str, Any]]:
    for line in lines:
        try:
            found = json.loads(line)
        except ValueError:
            continue
        if isinstance(found, dict):
            yield found


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
