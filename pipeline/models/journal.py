"""The journal of an endpoint's calls: what an admission that is made anew must know to hold the same limits.

One line when a call is let through and one when its cost is known, written before anyone acts on it. A killed process
loses none of them; a machine that goes down may lose the last seconds, after which the minute is over anyway.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.models.admission import Done, Wish
from pipeline.models.budget import Spend
from pipeline.models.rate import MINUTE_S
from schemas.errors import StopError

REMEMBERED_S = 2 * MINUTE_S
"""Age up to which calls are told apart: more than any window of a rate."""


@dataclass(frozen=True, slots=True)
class PastCall:
    """A call that an earlier admission let through."""

    wish: Wish
    """The call."""
    age_s: float
    """Seconds since it was let through."""
    tokens: int | None
    """What it used; None where no end is written."""
    same_session: bool
    """Whether it was let through in this session: without an end it may still be under way."""


@dataclass(frozen=True, slots=True)
class Remembered:
    """What a journal says."""

    spent: Spend
    """What ended calls used, and what calls of earlier sessions without an end may have used."""
    calls: tuple[PastCall, ...]
    """Calls that still matter, oldest first: the recent ones, and those of this session without an end."""
    pause_s: float
    """Seconds for which the server still wants no call, 0 or more."""


class Journal:
    """A file of lines that only grows. One writer at a time; the run's lock sees to that.

    Args:
        path: The file; made on first use.
        session: Name of this session of the run.
        wall_clock: Seconds since 1970, to tell how old a line is; where that clock was put back, a line counts as new.
    """

    def __init__(self, path: Path, session: str, wall_clock: Callable[[], float] = time.time) -> None:
        self._path, self._session, self._wall_clock = path, session, wall_clock
        self._file: int | None = None

    def __del__(self) -> None:
        if self._file is not None:
            os.close(self._file)

    def record(self, entry: Wish | Done) -> None:
        """Add a line.

        Raises:
            StopError: It cannot be written: then no call may go.
        """
        line: dict[str, Any] = {"tokens": entry.tokens, "usd": entry.usd}
        if isinstance(entry, Wish):
            line = {"sent": entry.id, "key": entry.key, "session": self._session, "at": self._wall_clock(), **line}
        elif entry.sent:
            line = {"done": entry.id, **line}
            if entry.pause_s is not None:
                line |= {"pause": entry.pause_s, "at": self._wall_clock()}
        else:
            line = {"unsent": entry.id}
        try:
            if self._file is None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
            # The line break comes first: a line cut short by a crash does not swallow the next one.
            content = b"\n" + json.dumps(line).encode()
            if os.write(self._file, content) < len(content):
                raise OSError("cut short")
        except OSError as error:
            raise StopError(f"{self._path}: what calls cost cannot be noted: {error.strerror or error}") from error

    def read(self) -> Remembered:
        """Return what was written so far; a line that was cut short is passed over."""
        sent, ended = self._entries()
        spent, calls, now = Spend(), list[PastCall](), self._wall_clock()
        for wish_id, start in sent.items():
            wish = Wish(wish_id, start["tokens"], start["usd"], start["key"])
            end, same = ended.get(wish_id), start["session"] == self._session
            if end is not None or not same:
                counted = start if end is None or end["tokens"] is None else end
                spent.add(1, counted["tokens"], counted["usd"])
            age_s = max(0.0, now - start["at"])
            if age_s < REMEMBERED_S or (same and end is None):
                tokens = None if end is None else (wish.tokens if end["tokens"] is None else end["tokens"])
                calls.append(PastCall(wish, age_s, tokens, same))
        pauses = (end["pause"] - max(0.0, now - end["at"]) for end in ended.values() if "pause" in end)
        return Remembered(spent, tuple(calls), max(0.0, max(pauses, default=0.0)))

    def unended(self) -> tuple[Wish, ...]:
        """Return the calls of earlier sessions without an end, where none was sent later for the same key."""
        sent, ended = self._entries()
        last = {entry["key"]: entry for entry in sent.values() if entry["key"]}
        return tuple(
            Wish(entry["sent"], entry["tokens"], entry["usd"], key)
            for key, entry in last.items()
            if entry["sent"] not in ended and entry["session"] != self._session
        )

    def _entries(self) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
        """Return the lines on calls let through and on their ends, by wish."""
        sent: dict[str, dict[str, Any]] = {}
        ended: dict[str, dict[str, Any]] = {}
        if self._path.exists():
            with self._path.open("rb") as lines:
                for entry in map(_decoded, lines):
                    if "sent" in entry:
                        sent.setdefault(entry["sent"], entry)
                    elif "done" in entry:
                        ended[entry["done"]] = entry
                    elif "unsent" in entry:
                        sent.pop(entry["unsent"], None)
        return sent, ended


def _decoded(line: bytes) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
