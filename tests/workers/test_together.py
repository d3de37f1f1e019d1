from __future__ import annotations

import asyncio
from typing import Any

import pytest

from schemas.errors import QuestionError
from schemas.questions import Question
from workers.together import Failed, Together, each, each_async

QUESTIONS = tuple(Question(str(number), "s", "eqa", "q") for number in range(3))


class Unsendable(Exception):
    """Pickle cannot rebuild it: its constructor takes more than its message."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(first)


def values(found: Together) -> list[Any]:
    return [value.error if isinstance(value, Failed) else value for value in found.values]


def test_error_stays_in_its_questions_place_and_skips_the_steps_after() -> None:
    def first(question: Question) -> str:
        if question.question_id == "1":
            raise QuestionError("no")
        return f"first {question.question_id}"

    called = list[str]()

    def second(question: Question, before: str) -> str:
        called.append(question.question_id)
        return f"{before}, second"

    one = each(first, QUESTIONS)
    found = values(each(second, QUESTIONS, one))
    assert (found[0], found[2]) == ("first 0, second", "first 2, second")
    assert isinstance(found[1], QuestionError)
    assert called == ["0", "2"]


def test_questions_wait_at_once_and_the_time_of_the_steps_before_counts() -> None:
    async def step(question: Question, before: float) -> float:
        await asyncio.sleep(0.1)
        if question.question_id == "2":
            raise QuestionError("no")
        return before + 1

    found = asyncio.run(each_async(step, QUESTIONS, Together((1.0, Failed(QuestionError("gone")), 3.0), 5.0)))
    assert values(found)[0] == 2.0
    assert [str(error) for error in values(found)[1:]] == ["gone", "no"]
    assert 5.1 <= found.seconds < 5.25


def test_cancelled_step_is_no_answer() -> None:
    async def step(question: Question) -> None:
        raise asyncio.CancelledError

    with pytest.raises(asyncio.CancelledError):
        asyncio.run(each_async(step, QUESTIONS))


def test_error_that_cannot_travel_is_told_in_words() -> None:
    def step(question: Question) -> None:
        raise Unsendable("what happened", "x")

    (error, *_) = values(each(step, QUESTIONS))
    assert str(error) == "Unsendable: what happened"
    assert any("in step" in note for note in error.__notes__)
