"""What a person sees while questions are answered: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections import Counter
from types import TracebackType
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

LINE_S = 10.0
"""Seconds between lines when there is no terminal: enough to see life, few enough for a log."""


class Progress(Protocol):
    """Told how a run goes."""

    def begin(self, total: int, done: int) -> None:
        """A run of `total` questions begins, `done` of them committed before."""
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
    """Plain lines on standard error."""

    def __init__(self) -> None:
        self._total = self._done = self._before = 0
        self._errors: Counter[str] = Counter()
        self._began = self._spoke = time.monotonic()

    def begin(self, total: int, done: int) -> None:
        """Say how much there is to do."""
        self._total, self._done, self._before = total, done, done
        self._began = self._spoke = time.monotonic()
        self.say(f"{total} questions" + (f", {done} done before" if done else ""))

    def advance(self, error: str) -> None:
        """Say now and then how far it is."""
        self._done += 1
        if error:
            self._errors[error] += 1
        if time.monotonic() - self._spoke >= LINE_S or self._done == self._total:
            self._spoke = time.monotonic()
            rate = (self._done - self._before) / max(self._spoke - self._began, 1e-9)
            left = (self._total - self._done) / rate
            errors = f", {self._errors.total()} failed" if self._errors else ""
            self.say(f"{self._done}/{self._total} questions, {rate:.1f}/s, {left:.0f} s left{errors}")

    def say(self, text: str) -> None:
        """Write a line."""
        print(text, file=sys.stderr, flush=True)

    def end(self) -> None:
        """Say which errors there were."""
        if self._errors:
            self.say("failed questions: " + ", ".join(f"{kind} {n}" for kind, n in self._errors.most_common()))


class Bar:
    """A bar with rate and time left, on a terminal."""

    def __init__(self) -> None:
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
            TextColumn("questions"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[failed]}"),
            console=Console(stderr=True),
        )
        self._task = self._bar.add_task("questions", total=total, completed=done, failed="")
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
            self.say("failed questions: " + ", ".join(f"{kind} {n}" for kind, n in self._errors.most_common()))


class Shown:
    """A progress that ends with its block, whatever happens in it.

    Args:
        progress: What is shown.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def __enter__(self) -> Progress:
        return self._progress

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._progress.end()


def for_terminal() -> Progress:
    """Return the bar where standard error is a terminal, else plain lines."""
    return Bar() if sys.stderr.isatty() else Lines()
