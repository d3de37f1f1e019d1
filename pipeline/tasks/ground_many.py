"""Multi-target grounding: the model says of each final view whether it shows a target (paper 3.4)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from pipeline.models.caller import Caller
from pipeline.models.messages import ImagePart
from pipeline.models.replies import parse_yes_no
from pipeline.query.ask_all import ask_all
from pipeline.tasks.task_answer import TaskAnswer, unreadable
from schemas.calls import CallRow
from schemas.questions import Question


async def ground_many(
    question: Question, images: Sequence[ImagePart], arm: str, caller: Caller, calls: list[CallRow]
) -> TaskAnswer:
    """Return the images (L' of L, none is possible) that show a target; each is one instance, or its clusters are.

    Args:
        question: The referring query.
        images: The arm's views, at least one.
        arm: initial, final or verified.
        caller: Sends the call.
        calls: Where the rows are appended.
    """
    parse = partial(parse_yes_no, count=len(images))
    ask = caller.ask("answer_many", {"question": question.question}, images, parse, question=question, subject=arm)
    verdicts = (await ask_all([ask], calls))[0]
    if verdicts is None:
        return unreadable(arm)
    chosen = tuple(position for position, yes in enumerate(verdicts) if yes)
    return TaskAnswer("answered", "", described(chosen), chosen)


def described(chosen: Sequence[int]) -> str:
    """Return the images that were said to show a target, in words."""
    return f"targets in image {', '.join(map(str, chosen))}" if chosen else "no target in any image"
