"""Single-target grounding: the model names one final view, whose region is the prediction (paper 3.4)."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.models.caller import Caller
from pipeline.models.messages import ImagePart
from pipeline.query.savings import ONE_IMAGE, Savings
from pipeline.tasks.eqa import ask_image_answer
from pipeline.tasks.task_answer import TaskAnswer, unreadable
from schemas.calls import CallRow
from schemas.questions import Question


async def ground_one(
    question: Question,
    images: Sequence[ImagePart],
    known: str | None,
    arm: str,
    caller: Caller,
    calls: list[CallRow],
    savings: Savings | None,
) -> TaskAnswer:
    """Return the one image (L' = 1) that shows the target, and what the model says of it.

    With one image there is nothing to choose. When the model has answered from that image alone before, it is not
    asked again: the region is the same whatever it says.

    Args:
        question: The referring query.
        images: The arm's views, at least one.
        known: The model's answer from the only image; None when there are several or it was not asked.
        arm: initial, final or verified.
        caller: Sends the call.
        calls: Where the rows are appended.
        savings: Counts the call when it is spared; None to make it.
    """
    if savings is not None and len(images) == 1 and known is not None:
        savings.add("answer", ONE_IMAGE)
        return TaskAnswer("answered", "", known, (0,))
    value = await ask_image_answer(question, images, arm, caller, calls)
    return unreadable(arm) if value is None else TaskAnswer("answered", "", value.answer, (value.index,))
