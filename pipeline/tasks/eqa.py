"""Embodied question answering: one text answer from all final views (paper 3.4)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from pipeline.models.caller import Caller
from pipeline.models.messages import ImagePart
from pipeline.models.replies import ImageAnswer, parse_image_answer
from pipeline.query.ask_all import ask_all
from pipeline.tasks.task_answer import TaskAnswer, unreadable
from schemas.calls import CallRow
from schemas.questions import Question


async def answer_eqa(
    question: Question, images: Sequence[ImagePart], arm: str, caller: Caller, calls: list[CallRow]
) -> TaskAnswer:
    """Return the answer the model gives when it sees all task views, and the image it names.

    Args:
        question: The query.
        images: The arm's views, at least one.
        arm: initial, final or verified; the row's subject.
        caller: Sends the call.
        calls: Where the rows are appended.
    """
    value = await ask_image_answer(question, images, arm, caller, calls)
    return unreadable(arm) if value is None else TaskAnswer("answered", "", value.answer, (value.index,))


async def ask_image_answer(
    question: Question, images: Sequence[ImagePart], arm: str, caller: Caller, calls: list[CallRow]
) -> ImageAnswer | None:
    """Return the image and the text of the reply to the answer prompt, which single-target grounding shares."""
    parse = partial(parse_image_answer, count=len(images))
    ask = caller.ask("answer_one", {"question": question.question}, images, parse, question=question, subject=arm)
    return (await ask_all([ask], calls))[0]
