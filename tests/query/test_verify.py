from __future__ import annotations

import asyncio

from pipeline.query.savings import Saved, Savings
from pipeline.query.verify import FINAL, INITIAL, verify_answers
from schemas.calls import CallRow
from schemas.questions import Question
from tests.query.tiny import Scripted, caller_of

QUESTION = Question("q", "tiny", "eqa", "What is on the table?")


def _verify(client: Scripted, pairs: list[tuple[str, str]]) -> list[int | None]:
    calls: list[CallRow] = []
    subjects = [f"p{i}" for i in range(len(pairs))]
    return asyncio.run(verify_answers(QUESTION, pairs, subjects, caller_of(client), calls, Savings()))


def test_initial_answer_is_candidate_0_and_final_answer_candidate_1() -> None:
    client = Scripted({"verify": "1"})
    assert _verify(client, [("I cannot tell.", "A cup.")]) == [FINAL]
    assert client.requests[0].variables["candidates"] == ["I cannot tell.", "A cup."]
    assert _verify(Scripted({"verify": "0"}), [("A cup.", "I cannot tell.")]) == [INITIAL]


def test_equal_answers_keep_the_initial_one_and_ask_nothing() -> None:
    client, savings = Scripted({}), Savings()
    pairs = [("A cup.", "A cup.")]
    assert asyncio.run(verify_answers(QUESTION, pairs, ["p"], caller_of(client), [], savings)) == [INITIAL]
    assert not client.requests
    assert savings.entries() == (Saved("verify", "equal answers", 1),)
    assert asyncio.run(verify_answers(QUESTION, pairs, ["p"], caller_of(client), [], None)) == [FINAL]
    assert client.count("verify") == 1


def test_several_pairs_are_verified_one_by_one_in_order() -> None:
    client = Scripted({"verify": lambda request: "1" if request.variables["candidates"][1] == "better" else "0"})
    assert _verify(client, [("a", "worse"), ("same", "same"), ("b", "better")]) == [INITIAL, INITIAL, FINAL]


def test_an_unreadable_verdict_is_none() -> None:
    assert _verify(Scripted({"verify": "both are fine"}), [("a", "b")]) == [None]
