"""What a person sees while questions are answered: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

LINE_S = 10.0
"""Seconds between lines when there is no terminal: enough to see life, few enough for a log."""


class Progress(Protocol):
    """Told how a run goes."""

    def begin(self, total: int, done: int) -> None:
        """A run of `total` questions, or other items, begins, `done` of them committed before."""
        ...

    def advance(self, error: str) -> None:
        """A question ended; `error` names the error its rows record, if any."""
        ...

    def say(self, text: str) -> None:
        """Something a person should read."""
        ...

    def end(self) -> None:
        """The run ended, well or not."""
        ...


class Silent:
    """Says nothing; for callers of the Python API."""

    def begin(self, total: int, done: int) -> None:
        """Say nothing."""

    def advance(self, error: str) -> None:
        """Say nothing."""

    def say(self, text: str) -> None:
        """Say nothing."""

    def end(self) -> None:
        """Say nothing."""


class Lines:
    """Plain lines on standard error.

    Args:
        clock: Seconds that only grow.
        items: What is counted.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, items: str = "questions") -> None:
        self._clock, self._items = clock, items
        self._total = self._done = self._timed = 0
        self._errors: Counter[str] = Counter()
        self._first = self._spoke = clock()

    def begin(self, total: int, done: int) -> None:
        """Say how much there is to do."""
        self._total, self._done, self._timed = total, done, 0
        self._spoke = self._clock()
        self.say(f"{total} {self._items}" + (f", {done} done before" if done else ""))

    def advance(self, error: str) -> None:
        """Say now and then how far it is."""
        now = self._clock()
        self._done += 1
        if error:
            self._errors[error] += 1
        if self._timed == 0:
            # Loading the first scene and starting workers says nothing about the rate.
            self._first = now
        self._timed += 1
        if now - self._spoke >= LINE_S or self._done == self._total:
            self._spoke = now
            errors = f", {self._errors.total()} failed" if self._errors else ""
            self.say(f"{self._done}/{self._total} {self._items}{self._rate(now)}{errors}")

    def _rate(self, now: float) -> str:
        if self._timed < 2 or now <= self._first:
            return ""
        rate = (self._timed - 1) / (now - self._first)
        return f", {rate:.1f}/s, {(self._total - self._done) / rate:.0f} s left"

    def say(self, text: str) -> None:
        """Write a line."""
        print(text, file=sys.stderr, flush=True)

    def end(self) -> None:
        """Say which errors there were."""
        if self._errors:
            self.say(f"failed {self._items}: " + ", ".join(f"{kind} {n}" for kind, n in self._errors.most_common()))


class Bar:
    """A bar with rate and time left, on a terminal.

    Args:
        items: What is counted.
    """

    def __init__(self, items: str = "questions") -> None:
        self._items = items
        self._bar: RichProgress | None = None
        self._errors: Counter[str] = Counter()

    def begin(self, total: int, done: int) -> None:
        """Show the bar."""
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        self._bar = Progress(
            TextColumn(self._items),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[failed]}"),
            console=Console(stderr=True),
        )
        self._task = self._bar.add_task(self._items, total=total, completed=done, failed="")
        self._bar.start()

    def advance(self, error: str) -> None:
        """Move the bar."""
        if error:
            self._errors[error] += 1
        if self._bar is not None:
            failed = f"[red]{self._errors.total()} failed" if self._errors else ""
            self._bar.update(self._task, advance=1, failed=failed)

    def say(self, text: str) -> None:
        """Write a line above the bar."""
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False)
        else:
            print(text, file=sys.stderr, flush=True)

    def end(self) -> None:
        """Take the bar down and say which errors there were."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
        if self._errors:
            self.say(f"failed {self._items}: " + ", ".join(f"{kind} {n}" for kind, n in self._errors.most_common()))


def for_terminal(items: str = "questions") -> Progress:
    """Return the bar where standard error is a terminal, else plain lines; `items` says what is counted."""
    return Bar(items) if sys.stderr.isatty() else Lines(items=items)
