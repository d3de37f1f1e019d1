"""Descriptions of pictures, and answers from descriptions: what the baselines that work on text share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pipeline.baselines.material import Material
from pipeline.baselines.rows import ARM
from pipeline.models.caller import Caller
from pipeline.models.replies import parse_caption, parse_text
from pipeline.query.ask_all import ask_all
from pipeline.tasks.task_answer import TaskAnswer, unreadable
from schemas.calls import CallRow
from schemas.questions import Question


async def describe(question: Question, material: Material, caller: Caller, calls: list[CallRow]) -> list[str | None]:
    """Return a description of every picture, None where none could be read.

    The question is no part of what is asked, so that every question of a scene finds the descriptions stored that the
    first one paid for.

    Args:
        question: Whose rows the calls become.
        material: Pictures, and what each was cut out around.
        caller: Sends the calls.
        calls: Where the rows are appended.
    """
    labels: Sequence[str] = material.labels or [""] * len(material.pictures)
    asks = [
        caller.ask(
            "caption", {"object": label} if label else {}, [image], parse_caption, question=question, subject=name
        )
        for image, label, name in zip(material.pictures, labels, material.names, strict=True)
    ]
    return await ask_all(asks, calls)


async def answer_notes(
    question: Question, notes: Sequence[str], of: Literal["pictures", "objects"], caller: Caller, calls: list[CallRow]
) -> TaskAnswer:
    """Return a language model's answer from notes; without any there is nothing to answer from.

    Args:
        question: The query.
        notes: One a picture or an object.
        of: What they describe.
        caller: Sends the call.
        calls: Where the rows are appended.
    """
    if not notes:
        return TaskAnswer("unparsed", f"there is no description of {of}", "", ())
    variables = {"question": question.question, "notes": list(notes)}
    if of == "objects":
        variables["design"] = "objects"
    ask = caller.ask("answer_text", variables, (), parse_text, question=question, subject=ARM)
    text = (await ask_all([ask], calls))[0]
    return unreadable(ARM) if text is None else TaskAnswer("answered", "", text, ())
