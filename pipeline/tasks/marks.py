"""LLM-Match marks of the arms' answers, where a reference answer is known (paper 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.metrics.llm_match import MISSING_MARK, cut_prediction, needs_judge
from pipeline.models.caller import Caller
from pipeline.models.replies import parse_mark
from pipeline.query.ask_all import ask_all
from pipeline.query.savings import EQUAL_ANSWERS, Savings
from schemas.calls import CallRow
from schemas.questions import Question


@dataclass(frozen=True, slots=True)
class Mark:
    """What the judge gave."""

    mark: int | None
    """1 to 5, 0 for a missing answer; None when unscored."""
    reason: str
    """Why it is unscored; empty when it is scored."""


async def mark_answers(
    question: Question,
    answers: Sequence[str | None],
    arms: Sequence[str],
    caller: Caller,
    calls: list[CallRow],
    savings: Savings | None,
) -> list[Mark]:
    """Return the mark of every answer; equal texts are judged once, a blank one is marked as missing without a call.

    Args:
        question: With its reference answer, and others that it accepts.
        answers: Answer texts; None for an arm without one, which stays unscored.
        arms: Names of the arms that gave them; a call's row names all that gave the text it judges.
        caller: Sends the calls.
        calls: Where the rows are appended.
        savings: Counts the marks not asked for; None to ask for each arm's.
    """
    given = [(arm, text) for arm, text in zip(arms, answers, strict=True) if text is not None and needs_judge(text)]
    subjects = given
    if savings is not None:
        texts = dict.fromkeys(text for _, text in given)
        subjects = [(", ".join(arm for arm, said in given if said == text), text) for text in texts]
        savings.add("judge", EQUAL_ANSWERS, len(given) - len(subjects))
    asks = [
        caller.ask(
            "judge",
            {
                "question": question.question,
                "answer": question.answer,
                "prediction": cut_prediction(text),
                "extra_answers": list(question.extra_answers),
            },
            (),
            parse_mark,
            question=question,
            subject=subject,
        )
        for subject, text in subjects
    ]
    values = await ask_all(asks, calls)
    marks = dict(zip((text for _, text in subjects), values, strict=True))
    found = []
    for answer in answers:
        if answer is None:
            found.append(Mark(None, "no answer"))
        elif not needs_judge(answer):
            found.append(Mark(MISSING_MARK, ""))
        elif marks[answer] is None:
            found.append(Mark(None, "the mark could not be read"))
        else:
            found.append(Mark(marks[answer], ""))
    return found
