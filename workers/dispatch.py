"""Bounded dispatch of questions, or of captures to be built, to a backend: the same loop in-process and on Ray.

It owns the questions in flight, the ledger of tries, the deadline of each and what becomes of an error; a backend only
starts questions and says which have ended. What Ray would retry by itself is switched off: a retry is decided here, by
error type, and counted.

Questions travel in batches (`pace.py`) and end one by one: an error is its question's alone, and when a whole batch is
lost its questions are tried again each alone, so that the one that kills its worker takes no other down. A unit that
builds a scene has one item, its capture, which is dispatched as a question is.
"""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from schemas.errors import RetryError, SplatReasonerError, StopError, StoppedError
from workers.pace import Limits, Pace
from workers.steps import Tables

__all__ = [
    "Backend",
    "DeadlineError",
    "Ended",
    "Limits",
    "OutOfMemoryError",
    "Outcome",
    "Unit",
    "WorkerLostError",
    "dispatch",
]

TICK_S = 1.0
"""Longest wait before deadlines and the stop flag are looked at again."""

RETRY_WAIT_S = 2.0
"""Wait before a question's second try; doubles with each try. A process that was killed takes seconds to come back."""


class WorkerLostError(RetryError):
    """The process, actor, node or object that held this question's work or its scene is gone."""


class OutOfMemoryError(WorkerLostError):
    """The process that held this question's work was killed because its node ran out of memory."""


class DeadlineError(RetryError):
    """A question had no result in time."""


class Unit(Protocol):
    """A planned unit: what is dispatched are its items, which are questions or one capture."""

    @property
    def id(self) -> str:
        """Unit id."""
        ...

    @property
    def items(self) -> Sequence[Any]:
        """Its items, in order."""
        ...

    @property
    def item_names(self) -> Sequence[str]:
        """Their ids, as rows carry them."""
        ...


H = TypeVar("H")
U = TypeVar("U", bound=Unit)
U_contra = TypeVar("U_contra", bound=Unit, contravariant=True)


@dataclass(frozen=True, slots=True)
class Ended:
    """What became of questions that travelled together."""

    results: Sequence[Tables | Exception]
    """Each one's records, or the error that ended it."""
    seconds: float = 0.0
    """What their steps took; time in queues is not in it."""
    held: int = 0
    """Bytes they held between steps."""


@dataclass(frozen=True, slots=True)
class Outcome(Generic[U]):
    """One question's end."""

    unit: U
    """Its unit."""
    position: int
    """Its place in the unit."""
    tables: Tables
    """Its records."""
    tries: int
    """1 when the first try succeeded."""
    error: str
    """Class name of the error its rows record; empty when there was none."""


class Backend(Protocol, Generic[H, U_contra]):
    """Where questions, or other items of units, run."""

    def submit(self, unit: U_contra, questions: Sequence[Any]) -> H:
        """Start questions of a unit, which travel together, without waiting for them."""
        ...

    def wait(self, handles: Sequence[H], timeout_s: float) -> Sequence[H]:
        """Return the handles that have ended, after at least one has or the time is over."""
        ...

    def result(self, handle: H) -> Ended:
        """Return what became of each question, or raise what ended them all (WorkerLostError for lost work)."""
        ...

    def cancel(self, handle: H) -> None:
        """Give up questions; their effects, all idempotent, may still happen."""
        ...

    def forget(self, unit: U_contra) -> None:
        """Drop what is held of the unit's scene, so that the next try loads it anew."""
        ...

    def failed(self, question: Any, error: Exception) -> Tables:
        """Return the records of a question that ended in an error."""
        ...


@dataclass(slots=True)
class _Try(Generic[U]):
    unit: U
    position: int
    number: int = 1
    excused: int = 0
    """Tries that do not count, since another question may have been to blame."""
    out_of_memory: int = 0
    """Tries that ended so."""
    not_before: float = 0.0

    @property
    def item(self) -> Any:
        return self.unit.items[self.position]

    def may_retry(self, error: Exception, limits: Limits) -> bool:
        enough = self.out_of_memory >= limits.oom_tries or self.number - self.excused > limits.retries
        return isinstance(error, RetryError) and not enough


@dataclass(frozen=True, slots=True)
class _Batch(Generic[U]):
    tries: Sequence[_Try[U]]
    deadline: float


def dispatch(
    units: Iterable[U],
    backend: Backend[H, U],
    limits: Limits,
    *,
    should_stop: Callable[[], bool] = lambda: False,
    note: Callable[..., None] = lambda kind, **details: None,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[Outcome[U]]:
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
    pace, fresh, again = Pace(limits), _Fresh(units), deque[_Try[U]]()
    running: dict[H, _Batch[U]] = {}
    in_flight = 0
    stop: StopError | None = None
    drain_until = float("inf")

    while True:
        stopping = stop is not None or should_stop()
        if stopping:
            drain_until = min(drain_until, clock() + limits.drain_s)
        while not stopping and pace.room(in_flight, len(running)):
            tries = _due(again, clock()) or fresh.take(pace.together)
            if not tries:
                break
            handle = backend.submit(tries[0].unit, [attempt.item for attempt in tries])
            running[handle] = _Batch(tries, clock() + limits.timeout_s)
            in_flight += len(tries)
        if not running:
            if stopping or not again:
                break
            sleep(min(TICK_S, max(0.0, min(attempt.not_before for attempt in again) - clock())))
            continue
        ended = set(backend.wait(tuple(running), TICK_S))
        now = clock()
        overdue = {handle for handle, batch in running.items() if now > batch.deadline} - ended
        for handle in [handle for handle in running if handle in ended or handle in overdue]:
            should_stop()  # without a head each of these results is waited for in vain: the first is enough
            batch = running.pop(handle).tries
            in_flight -= len(batch)
            results = _results(backend, handle, batch, limits.timeout_s if handle in overdue else None, pace)
            if any(isinstance(found, WorkerLostError) for found in results):
                backend.forget(batch[0].unit)
            for attempt, found in zip(batch, results, strict=True):
                if not isinstance(found, Exception):
                    yield Outcome(attempt.unit, attempt.position, found, attempt.number, "")
                    continue
                if isinstance(found, StopError):
                    stop = stop or found
                    continue
                if isinstance(found, StoppedError):
                    continue  # as asked: not done, and nothing wrong with it
                kind = type(found).__name__
                told = {
                    "unit": attempt.unit.id,
                    "question": attempt.unit.item_names[attempt.position],
                    "error": kind,
                    "tries": attempt.number,
                }
                if attempt.may_retry(found, limits):
                    note("retry", **told, message=str(found))
                    attempt.not_before = clock() + RETRY_WAIT_S * 2 ** (attempt.number - 1)
                    attempt.number += 1
                    again.append(attempt)
                    continue
                note("failed", **told, **_told(found))
                tables = backend.failed(attempt.item, found)
                yield Outcome(attempt.unit, attempt.position, tables, attempt.number, kind)
        if clock() > drain_until:
            note("gave_up", questions=in_flight)
            for handle in running:
                backend.cancel(handle)
            break
    if stop is not None:
        raise stop


class _Fresh(Generic[U]):
    """The questions that have not been tried, in plan order."""

    def __init__(self, units: Iterable[U]) -> None:
        self._units = iter(units)
        self._left: deque[_Try[U]] = deque()

    def take(self, most: int) -> list[_Try[U]]:
        """Return the next questions, all of one unit and so of one scene; none at the end."""
        if not self._left and (unit := next(self._units, None)) is not None:
            self._left.extend(_Try(unit, position) for position in range(len(unit.items)))
        # In equal pieces: 10, 10 and 5 would take longer side by side than 9, 8 and 8.
        pieces = -(-len(self._left) // most)
        count = -(-len(self._left) // pieces) if pieces else 0
        return [self._left.popleft() for _ in range(count)]


def _due(again: deque[_Try[U]], now: float) -> list[_Try[U]]:
    """Take out the first question whose wait for its next try is over; it travels alone."""
    found = next((attempt for attempt in again if attempt.not_before <= now), None)
    if found is None:
        return []
    again.remove(found)
    return [found]


def _results(
    backend: Backend[H, U], handle: H, tries: Sequence[_Try[U]], overdue_s: float | None, pace: Pace
) -> Sequence[Tables | Exception]:
    """Return what became of each question of a batch; an error of the whole batch is each one's."""
    try:
        if overdue_s is not None:
            backend.cancel(handle)
            raise DeadlineError(f"no result within {overdue_s:g} s")
        ended = backend.result(handle)
    except Exception as error:
        in_company = len(tries) > 1 and isinstance(error, WorkerLostError | DeadlineError)
        for attempt in tries:
            attempt.excused += in_company
            attempt.out_of_memory += isinstance(error, OutOfMemoryError) and not in_company
        return [error] * len(tries)
    pace.learn(len(tries), ended.seconds, ended.held)
    return ended.results


def _told(error: Exception) -> dict[str, str]:
    """Return the message and, for an error nobody foresaw, where it arose."""
    if isinstance(error, SplatReasonerError):
        return {"message": str(error)}
    where = getattr(error, "__notes__", None) or traceback.format_exception(error)
    return {"message": str(error), "traceback": "".join(where)}
