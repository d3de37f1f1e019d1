"""A method that computes nothing but asks real models: what a question's text says is asked, nothing is rendered."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import partial
from typing import Any

from pipeline.models.caller import Caller, rows_of
from pipeline.models.replies import parse_index
from schemas.questions import Question
from tests.workers import fake_steps
from workers.method_steps import close_caller, make_caller

CALLS = 4
"""Of each question, one of which every question makes."""


async def find_evidence(question: Question, vocabulary: tuple[str, ...], caller: Caller, method: Any) -> Any:
    return await _ask(question, caller, ["what every question asks", "b"], "shared")


async def decide(question: Question, proposal: Any, caller: Caller, method: Any) -> Any:
    pairs = [[question.question, str(number)] for number in range(CALLS - 1)]
    return await asyncio.gather(*(_ask(question, caller, pair, f"pair {pair[1]}") for pair in pairs))


async def _ask(question: Question, caller: Caller, pair: list[str], subject: str) -> Any:
    # The text is the same for all, so that equal pairs are equal requests.
    variables = {"question": "Which one?", "candidates": pair}
    return await caller.ask("verify", variables, (), partial(parse_index, count=2), question=question, subject=subject)


def conclude(
    context: Any, question: Question, evidence: Any, proposal: Any, decision: Any, method: Any
) -> dict[str, tuple[Any, ...]]:
    asked = [evidence, *decision]
    text = " ".join(str(one.value) for one in asked)
    return {
        "answers": (fake_steps.answer(question, answer=text),),
        "arms": (fake_steps.arm(question, "final", answer=text),),
        "calls": tuple(row for one in asked for row in one.rows),
    }


def propose(context: Any, question: Question, evidence: Any, method: Any) -> dict[str, Any]:
    return dict(context)


def no_thumbnails(proposal: Any, rows: Any) -> dict[str, Any]:
    return {}


def failed_rows(question: Question, error: Exception, method: Any = None) -> dict[str, tuple[Any, ...]]:
    return {**fake_steps.failed_rows(question, error), "calls": rows_of(error)}


STEPS = replace(
    fake_steps.STEPS,
    make_caller=make_caller,
    close_caller=close_caller,
    find_evidence=find_evidence,
    propose=propose,
    decide=decide,
    conclude=conclude,
    thumbnails=no_thumbnails,
    failed_rows=failed_rows,
)
