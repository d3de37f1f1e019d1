"""Bounded dispatch of questions to a backend, the same loop in-process and on Ray.

It owns the window of questions in flight, the ledger of tries, the deadline of each and what becomes of an error; a
backend only starts questions and says which have ended. What Ray would retry by itself is switched off: a retry is
decided here, by error type, and counted.
"""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from schemas.errors import RetryError, SplatReasonerError, StopError
from schemas.plan import PlannedUnit
from schemas.questions import Question
from workers.steps import Tables

H = TypeVar("H")

TICK_S = 1.0
"""Longest wait before deadlines and the stop flag are looked at again."""


RETRY_WAIT_S = 2.0
"""Wait before a question's second try; doubles with each try. A process that was killed takes seconds to come back."""


class WorkerLostError(RetryError):
    """The process, actor, node or object that held this question's work or its scene is gone."""


class DeadlineError(RetryError):
    """A question had no result in time."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of dispatch."""

    in_flight: int
    """Questions begun and not ended."""
    timeout_s: float
    """Seconds a try may take, waiting for slots included."""
    retries: int
    """Tries after the first, for errors that may pass."""
    drain_s: float = 60.0
    """Seconds that questions in flight get to end once the run is told to stop."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One question's end."""

    unit: PlannedUnit
    """Its unit."""
    position: int
    """Its place in the unit."""
    tables: Tables
    """Its records."""
    tries: int
    """1 when the first try succeeded."""
    error: str
    """Class name of the error its rows record; empty when there was none."""


class Backend(Protocol, Generic[H]):
    """Where questions run."""

    def submit(self, unit: PlannedUnit, question: Question) -> H:
        """Start a question without waiting for it."""
        ...

    def wait(self, handles: Sequence[H], timeout_s: float) -> Sequence[H]:
        """Return the handles that have ended, after at least one has or the time is over."""
        ...

    def result(self, handle: H) -> Tables:
        """Return an ended question's records, or raise the error that ended it (WorkerLostError for lost work)."""
        ...

    def cancel(self, handle: H) -> None:
        """Give up a question; its effects, all idempotent, may still happen."""
        ...

    def forget(self, unit: PlannedUnit) -> None:
        """Drop what is held of the unit's scene, so that the next try loads it anew."""
        ...

    def failed(self, question: Question, error: Exception) -> Tables:
        """Return the records of a question that ended in an error."""
        ...


@dataclass(slots=True)
class _Try:
    unit: PlannedUnit
    position: int
    number: int
    deadline: float = 0.0
    not_before: float = 0.0


def dispatch(
    units: Iterable[PlannedUnit],
    backend: Backend[H],
    limits: Limits,
    *,
    should_stop: Callable[[], bool] = lambda: False,
    note: Callable[..., None] = lambda kind, **details: None,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[Outcome]:
    """Yield the outcome of every question, in the order they end.

    Args:
        units: Units to do; read only as far as the window needs.
        backend: Where questions run.
        limits: Bounds.
        should_stop: Looked at every tick; once true nothing new is begun and what is in flight may end.
        note: Told what happened, as a kind and details: "retry", "failed", "gave_up".
        clock: Seconds that only grow.
        sleep: Waits, while nothing is in flight and a question waits for its next try.

    Raises:
        StopError: A question met one; raised after what is in flight has ended or `drain_s` is over.
    """
    fresh = ((unit, position) for unit in units for position in range(len(unit.questions)))
    again: deque[_Try] = deque()
    running: dict[H, _Try] = {}
    stop: StopError | None = None
    drain_until = float("inf")

    while True:
        stopping = stop is not None or should_stop()
        if stopping:
            drain_until = min(drain_until, clock() + limits.drain_s)
        while not stopping and len(running) < limits.in_flight:
            attempt = _due(again, clock()) or _first(fresh)
            if attempt is None:
                break
            attempt.deadline = clock() + limits.timeout_s
            running[backend.submit(attempt.unit, attempt.unit.questions[attempt.position])] = attempt
        if not running:
            if stopping or not again:
                break
            sleep(min(TICK_S, max(0.0, min(attempt.not_before for attempt in again) - clock())))
            continue
        ended = backend.wait(tuple(running), TICK_S)
        overdue = [h for h, attempt in running.items() if clock() > attempt.deadline and h not in ended]
        for handle in (*ended, *overdue):
            attempt = running.pop(handle)
            question = attempt.unit.questions[attempt.position]
            kind = ""
            try:
                if handle in overdue:
                    backend.cancel(handle)
                    raise DeadlineError(f"no result within {limits.timeout_s:g} s")
                tables = backend.result(handle)
            except StopError as error:
                stop = stop or error
                continue
            except Exception as error:
                kind = type(error).__name__
                told = {"question": question.question_id, "error": kind, "tries": attempt.number}
                if isinstance(error, RetryError) and attempt.number <= limits.retries:
                    note("retry", **told, message=str(error))
                    if isinstance(error, WorkerLostError):
                        backend.forget(attempt.unit)
                    attempt.not_before = clock() + RETRY_WAIT_S * 2 ** (attempt.number - 1)
                    attempt.number += 1
                    again.append(attempt)
                    continue
                note("failed", **told, **_told(error))
                tables = backend.failed(question, error)
            yield Outcome(attempt.unit, attempt.position, tables, attempt.number, kind)
        if clock() > drain_until:
            note("gave_up", questions=len(running))
            for handle in running:
                backend.cancel(handle)
            break
    if stop is not None:
        raise stop


def _due(again: deque[_Try], now: float) -> _Try | None:
    """Take out the first question whose wait for its next try is over."""
    found = next((attempt for attempt in again if attempt.not_before <= now), None)
    if found is not None:
        again.remove(found)
    return found


def _first(fresh: Iterator[tuple[PlannedUnit, int]]) -> _Try | None:
    found = next(fresh, None)
    return None if found is None else _Try(*found, number=1)


def _told(error: Exception) -> dict[str, str]:
    """Return the message and, for an error nobody foresaw, where it arose."""
    if isinstance(error, SplatReasonerError):
        return {"message": str(error)}
    where = getattr(error, "__notes__", None) or traceback.format_exception(error)
    return {"message": str(error), "traceback": "".join(where)}
