"""What differs between two versions of a job, field by field, in words a person can act on."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from itertools import zip_longest
from typing import Any

from schemas.plan import PlannedUnit
from schemas.questions import Question

SHOWN = 64
"""Characters of a value that are shown: a hash fits, a prompt does not."""

TOLD = 20
"""Differences that are told; the others are counted."""

ABSENT = object()


def differences(before: Any, now: Any, place: str = "") -> Iterator[str]:
    """Yield a line for every field in which two pieces of plain data differ, such as "method.k: 4 then, 8 now".

    Args:
        before: Plain data: nested dicts, lists and values.
        now: The same, later.
        place: Name of the whole.
    """
    if isinstance(before, dict) and isinstance(now, dict):
        for key in sorted({*before, *now}):
            inner = f"{place}.{key}" if place else str(key)
            yield from differences(before.get(key, ABSENT), now.get(key, ABSENT), inner)
    elif before != now:
        yield f"{place}: {_shown(before)} then, {_shown(now)} now"


def unit_differences(before: Iterator[PlannedUnit], now: Iterator[PlannedUnit]) -> Iterator[str]:
    """Yield a line for every unit in which two plans differ by their scenes or questions.

    Args:
        before: Units of a plan.
        now: Units of another.
    """
    for number, (planned, found) in enumerate(zip_longest(before, now)):
        if planned is None or found is None:
            there, here = (f"scene {unit.scene}" if unit is not None else "nothing" for unit in (planned, found))
            yield f"unit {number}: {there} then, {here} now"
        elif planned.scene != found.scene:
            yield f"unit {number}: scene {planned.scene} then, {found.scene} now"
        elif planned.scene_sha256 != found.scene_sha256:
            yield f"unit {number}: the files of scene {planned.scene} have changed"
        elif planned.questions != found.questions:
            yield from _question_difference(planned.questions, found.questions, number)


def told(lines: Iterator[str]) -> list[str]:
    """Return the first lines, and how many more there are."""
    first = [line for line, _ in zip(lines, range(TOLD), strict=False)]
    more = sum(1 for _ in lines)
    return [*first, f"and {more} more"] if more else first


def _question_difference(before: tuple[Question, ...], now: tuple[Question, ...], number: int) -> Iterator[str]:
    """Yield what differs in the first questions of a unit that differ."""
    for one, other in zip_longest(before, now):
        if one is None or other is None or one.question_id != other.question_id:
            names = [question.question_id if question is not None else "nothing" for question in (one, other)]
            yield f"unit {number}: question {names[0]} then, {names[1]} now"
            return
        if one != other:
            yield from differences(dataclasses.asdict(one), dataclasses.asdict(other), f"question {one.question_id}")
            return


def _shown(value: Any) -> str:
    if value is ABSENT:
        return "nothing"
    text = value if isinstance(value, str) else repr(value)
    return repr(text[:SHOWN] + "...") if len(text) > SHOWN else repr(value)
