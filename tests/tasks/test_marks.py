"""Marks: who is asked, and that a missing answer is a mark of 0 and no call, as OpenEQA has it."""

from __future__ import annotations

import asyncio

from pipeline.query.savings import Savings
from pipeline.tasks.marks import Mark, mark_answers
from schemas.calls import CallRow
from schemas.questions import Question
from tests.query.tiny import Scripted, caller_of

QUESTION = Question("q", "s", "eqa", "What is red?", answer="the cup", extra_answers=("a mug",))


def _marks(answers: list[str | None], client: Scripted, savings: Savings | None) -> list[Mark]:
    calls: list[CallRow] = []
    arms = ["initial", "final", "verified"]
    return asyncio.run(mark_answers(QUESTION, answers, arms, caller_of(client), calls, savings))


def test_blank_answers_are_marked_zero_without_a_call_and_missing_ones_are_unscored() -> None:
    client = Scripted({"judge": "4"})
    assert _marks(["", " \n", None], client, None) == [Mark(0, ""), Mark(0, ""), Mark(None, "no answer")]
    assert client.count("judge") == 0


def test_judge_sees_the_answer_up_to_its_last_full_stop_and_every_reference() -> None:
    client = Scripted({"judge": "4"})
    assert _marks(["The cup. It is", "The cup. It is", None], client, Savings())[:2] == [Mark(4, ""), Mark(4, "")]
    (request,) = client.requests
    assert request.variables["prediction"] == "The cup."
    assert (request.variables["answer"], request.variables["extra_answers"]) == ("the cup", ["a mug"])


def test_marks_that_cannot_be_read_are_unscored_with_a_reason() -> None:
    assert _marks(["a", None, "b"], Scripted({"judge": "splendid"}), None)[0] == Mark(
        None, "the mark could not be read"
    )
