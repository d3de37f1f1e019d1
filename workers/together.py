"""A step done for questions that travel together: what goes wrong with one is carried along in its place."""

from __future__ import annotations

import asyncio
import pickle
import time
import traceback
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any

from schemas.errors import SplatReasonerError
from schemas.questions import Question


@dataclass(frozen=True, slots=True)
class Failed:
    """The error that ended a question, in the place of what a step would have given."""

    error: Exception
    """Picklable; its notes say where it arose when nobody foresaw it."""


@dataclass(frozen=True, slots=True)
class Together:
    """What a step gave for each question of a batch."""

    values: tuple[Any, ...]
    """In the batch's order; `Failed` where the question has ended."""
    seconds: float
    """What this step and those before it took for the whole batch; time in queues is not in it."""


def each(step: Callable[..., Any], questions: Sequence[Question], *before: Together) -> Together:
    """Return what a step gives for each question, one after the other.

    Args:
        step: Takes a question and what the steps before gave for it.
        questions: The batch.
        before: Those steps' results, in order; the latest holds the time of all.
    """

    def one(question: Question, *given: Any) -> Any:
        failed = _ended(given)
        if failed is not None:
            return failed
        try:
            return step(question, *given)
        except Exception as error:
            return Failed(_portable(error))

    start = time.perf_counter()
    values = tuple(one(*row) for row in _rows(questions, before))
    return Together(values, _spent(before) + time.perf_counter() - start)


async def each_async(step: Callable[..., Awaitable[Any]], questions: Sequence[Question], *before: Together) -> Together:
    """Return what a step that waits gives for each question, all at once; see `each`."""

    async def one(question: Question, *given: Any) -> Any:
        failed = _ended(given)
        if failed is not None:
            return failed
        try:
            return await step(question, *given)
        except Exception as error:
            return Failed(_portable(error))

    start = time.perf_counter()
    values = await asyncio.gather(*(one(*row) for row in _rows(questions, before)))
    return Together(tuple(values), _spent(before) + time.perf_counter() - start)


def _rows(questions: Sequence[Question], before: Sequence[Together]) -> list[tuple[Any, ...]]:
    return list(zip(questions, *(step.values for step in before), strict=True))


def _ended(given: Sequence[Any]) -> Failed | None:
    return next((value for value in given if isinstance(value, Failed)), None)


def _spent(before: Sequence[Together]) -> float:
    return before[-1].seconds if before else 0.0


def _portable(error: Exception) -> Exception:
    """Return the error as other processes can read it."""
    if not isinstance(error, SplatReasonerError):
        # The traceback stays behind; its text is what a person needs.
        error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception as why:
        found = RuntimeError(f"{type(error).__name__}: {error}")
        found.add_note(f"this error itself cannot be sent between processes: {why}")
        found.add_note("".join(traceback.format_exception(error)))
        return found
    return error
