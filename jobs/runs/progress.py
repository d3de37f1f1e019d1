"""What is told while questions are answered: a bar on a terminal; elsewhere one JSON object a line, or plain lines."""

from __future__ import annotations

import json
import sys
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from datetime import UTC, datetime
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Protocol

from jobs.runs.spend import CallTotals

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

LINE_S = 10.0
"""Seconds between lines when there is no terminal: enough to see life, few enough for a log."""


class Style(StrEnum):
    """How progress is told."""

    BAR = "bar"
    JSON = "json"
    PLAIN = "plain"


class Progress(Protocol):
    """Told how a run goes."""

    def begin(self, total: int, done: int) -> None:
        """A run of `total` questions, or other items, begins, `done` of them committed before."""
        ...

    def advance(self, error: str) -> None:
        """A question ended; `error` names the error its rows record, if any."""
        ...

    def spent(self, calls: CallTotals) -> None:
        """Model calls ended, beside those told before."""
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

    def spent(self, calls: CallTotals) -> None:
        """Say nothing."""

    def say(self, text: str) -> None:
        """Say nothing."""

    def end(self) -> None:
        """Say nothing."""


class _Counting(ABC):
    """How far it is, told every `LINE_S` seconds and at the last item.

    Args:
        clock: Seconds that only grow.
        items: What is counted.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, items: str = "questions") -> None:
        self._clock, self._items = clock, items
        self._total = self._done = self._timed = 0
        self._errors: Counter[str] = Counter()
        self._calls: CallTotals | None = None
        self._first = self._spoke = clock()
        self._begun = False

    def begin(self, total: int, done: int) -> None:
        """Say how much there is to do."""
        self._total, self._done, self._timed = total, done, 0
        self._spoke, self._begun = self._clock(), True
        self._tell_begin()

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
            self._tell_progress(self._rate(now))

    def spent(self, calls: CallTotals) -> None:
        """Add to the calls; the next line tells them."""
        self._calls = calls if self._calls is None else self._calls + calls

    def _rate(self, now: float) -> float | None:
        """Return items a second since the first one ended."""
        return (self._timed - 1) / (now - self._first) if self._timed > 1 and now > self._first else None

    @abstractmethod
    def say(self, text: str) -> None:
        """Something a person should read."""

    @abstractmethod
    def end(self) -> None:
        """The run ended, well or not."""

    @abstractmethod
    def _tell_begin(self) -> None:
        """Say how much there is to do."""

    @abstractmethod
    def _tell_progress(self, rate: float | None) -> None:
        """Say how far it is, at so many items a second; None while that is not known."""


class Lines(_Counting):
    """Plain lines on standard error."""

    def _tell_begin(self) -> None:
        self.say(f"{self._total} {self._items}" + (f", {self._done} done before" if self._done else ""))

    def _tell_progress(self, rate: float | None) -> None:
        timing = "" if rate is None else f", {rate:.1f}/s, {(self._total - self._done) / rate:.0f} s left"
        errors = f", {self._errors.total()} failed" if self._errors else ""
        self.say(f"{self._done}/{self._total} {self._items}{timing}{errors}{_priced(self._calls)}")

    def say(self, text: str) -> None:
        """Write a line."""
        print(text, file=sys.stderr, flush=True)

    def end(self) -> None:
        """Say which errors there were."""
        if self._errors:
            self.say(_failures(self._items, self._errors))


class JsonLines(_Counting):
    """One JSON object a line on standard error: what a log collector reads.

    Every line has `time`, `event` (begin, progress, message or end) and `items`; all but messages have `done`, `total`,
    `failed` and, once calls are known, `calls`; progress has `rate` (items a second) and `left_s`, null when unknown.
    """

    def _tell_begin(self) -> None:
        self._write("begin", **self._counts())

    def _tell_progress(self, rate: float | None) -> None:
        left = None if rate is None else round((self._total - self._done) / rate, 1)
        self._write("progress", **self._counts(), rate=None if rate is None else round(rate, 3), left_s=left)

    def say(self, text: str) -> None:
        """Write a line with a message."""
        self._write("message", text=text)

    def end(self) -> None:
        """Say how it ended, with the number of each error; nothing where it never began."""
        if self._begun:
            self._write("end", **self._counts(), errors=dict(self._errors.most_common()))

    def _counts(self) -> dict[str, Any]:
        calls = {} if self._calls is None else {"calls": self._calls.as_event()}
        return {"done": self._done, "total": self._total, "failed": self._errors.total(), **calls}

    def _write(self, event: str, **details: Any) -> None:
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"time": now, "event": event, "items": self._items, **details}, ensure_ascii=False)
        print(line, file=sys.stderr, flush=True)


class Bar:
    """A bar with rate and time left, on a terminal.

    Args:
        items: What is counted.
    """

    def __init__(self, items: str = "questions") -> None:
        self._items = items
        self._bar: RichProgress | None = None
        self._errors: Counter[str] = Counter()
        self._calls: CallTotals | None = None

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
            TextColumn("{task.fields[told]}"),
            console=Console(stderr=True),
        )
        self._task = self._bar.add_task(self._items, total=total, completed=done, told="")
        self._bar.start()

    def advance(self, error: str) -> None:
        """Move the bar."""
        if error:
            self._errors[error] += 1
        if self._bar is not None:
            failed = f"[red]{self._errors.total()} failed[/red]" if self._errors else ""
            self._bar.update(self._task, advance=1, told=f"{failed}{_priced(self._calls)}")

    def spent(self, calls: CallTotals) -> None:
        """Add to the calls; the bar tells them with the next question."""
        self._calls = calls if self._calls is None else self._calls + calls

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
            self.say(_failures(self._items, self._errors))


def progress_style(plain: bool, log_json: bool) -> Style | None:
    """Return what two flags of a verb ask for; None when they leave it to the terminal.

    Raises:
        InputError: They contradict each other.
    """
    if plain and log_json:
        from schemas.errors import InputError

        raise InputError("--plain", expected="one of --plain and --log-json", found="both")
    return Style.PLAIN if plain else Style.JSON if log_json else None


def for_terminal(items: str = "questions", style: Style | None = None) -> Progress:
    """Return who tells how it goes.

    Args:
        items: What is counted.
        style: How; None for a bar where standard error is a terminal and JSON lines elsewhere.
    """
    style = style or (Style.BAR if sys.stderr.isatty() else Style.JSON)
    if style is Style.BAR:
        return Bar(items)
    return JsonLines(items=items) if style is Style.JSON else Lines(items=items)


def on_terminal(items: str) -> Progress:
    """Return a bar where standard error is a terminal; elsewhere nothing is told, for work that nobody collects."""
    return Bar(items) if sys.stderr.isatty() else Silent()


def _failures(items: str, errors: Counter[str]) -> str:
    return f"failed {items}: " + ", ".join(f"{kind} {n}" for kind, n in errors.most_common())


def _priced(calls: CallTotals | None) -> str:
    """Return calls for a person, once something was sent that costs tokens."""
    if calls is None or not calls.tokens:
        return ""
    return f", {calls.sent} calls, {calls.tokens} tokens" + (f", {calls.usd:.2f} USD" if calls.usd else "")
