"""The run's diary, events.jsonl: one JSON object a line, appended as things happen. No result depends on it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

from schemas import storage

EVENTS_FILE = "events.jsonl"


class EventLog:
    """Appends events of one driver.

    On an object store, which cannot append, the lines are kept and written when the driver ends, into a file of
    their own.

    Args:
        run: Run folder.
    """

    def __init__(self, run: str) -> None:
        self._run, self._kept = run, list[str]()
        self._path = storage.local_path(storage.join(run, EVENTS_FILE))
        self._started = _now()

    def note(self, kind: str, **details: Any) -> None:
        """Append an event of a kind, with its details."""
        line = json.dumps({"time": _now(), "event": kind, **details}, ensure_ascii=False) + "\n"
        if self._path is None:
            self._kept.append(line)
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write(line)

    def close(self) -> None:
        """Write what was kept."""
        if self._kept:
            name = f"events-{self._started.replace(':', '')}.jsonl"
            storage.write_bytes_atomic(storage.join(self._run, name), "".join(self._kept).encode())


def read_events(run: str) -> Iterator[dict[str, Any]]:
    """Yield a run's events; a line cut short by a crash is passed over, as the diary is no result."""
    uri = storage.join(run, EVENTS_FILE)
    if not storage.exists(uri):
        return
    for line in storage.read_bytes(uri).decode(errors="replace").splitlines():
        try:
            found = json.loads(line)
        except ValueError:
            continue
        if isinstance(found, dict):
            yield found


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
