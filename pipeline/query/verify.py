"""Verification: does the answer with novel views say more than the one without (paper 3.3)?"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from pipeline.models.caller import Caller
from pipeline.models.replies import parse_index
from pipeline.query.ask_all import ask_all
from pipeline.query.savings import EQUAL_ANSWERS, Savings
from schemas.calls import CallRow
from schemas.questions import Question

INITIAL, FINAL = 0, 1
"""Candidate numbers: without novel views and with them, as in the paper's prompt."""


async def verify_answers(
    question: Question,
    pairs: Sequence[tuple[str, str]],
    subjects: Sequence[str],
    caller: Caller,
    calls: list[CallRow],
    savings: Savings | None,
) -> list[int | None]:
    """Return for each (initial answer, final answer) which one stands, 0 or 1; None when it could not be read.

    Two equal texts are not asked about: the final view is taken only if it holds what was missing before, and here
    it adds nothing, so the initial one stands (docs/decisions/0002-verification.md).

    Args:
        question: The query.
        pairs: Answers to compare.
        subjects: What each pair is about, for the rows.
        caller: Sends the calls.
        calls: Where the rows are appended.
        savings: Counts the pairs not asked about; None to ask about all.
    """
    open_pairs = [number for number, (first, last) in enumerate(pairs) if savings is None or first != last]
    if savings is not None:
        savings.add("verify", EQUAL_ANSWERS, len(pairs) - len(open_pairs))
    asks = [
        caller.ask(
            "verify",
            {"question": question.question, "candidates": list(pairs[number])},
            (),
            partial(parse_index, count=2),
            question=question,
            subject=subjects[number],
        )
        for number in open_pairs
    ]
    verdicts = await ask_all(asks, calls)
    replies = dict(zip(open_pairs, verdicts, strict=True))
    return [replies.get(number, INITIAL) for number in range(len(pairs))]
