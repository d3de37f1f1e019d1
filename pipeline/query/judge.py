"""Judging views: the model answers from each candidate alone, then a text-only choice per cluster (paper 3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from pydantic import BaseModel, ConfigDict, Field

from pipeline.models.caller import Caller
from pipeline.models.messages import ImagePart
from pipeline.models.replies import parse_index, parse_text
from pipeline.query.ask_all import ask_all
from schemas.calls import CallRow
from schemas.questions import Question


class JudgeConfig(BaseModel):
    """Which judgements are made (paper 3.3 and 4.4)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    verify: bool = Field(default=True, description="Compare the answers of initial and final views (paper 3.3).")
    mark: bool = Field(default=True, description="Ask the judge for LLM-Match marks where a reference answer is known.")


@dataclass(frozen=True, slots=True)
class Choice:
    """Which candidate of a cluster the judge chose."""

    candidate: int | None
    """Position among the cluster's candidates; None when the choice could not be read."""
    reason: str = ""
    """Why there is none."""


async def answer_views(
    question: Question,
    images: Sequence[ImagePart],
    subjects: Sequence[str],
    caller: Caller,
    calls: list[CallRow],
) -> list[str | None]:
    """Return the model's answer from every image alone; None where its reply was blank.

    Args:
        question: The query.
        images: Distinct candidate views.
        subjects: Their candidate ids, for the rows.
        caller: Sends the calls.
        calls: Where the rows are appended.
    """
    variables = {"question": question.question}
    asks = [
        caller.ask("view_answer", variables, (image,), parse_text, question=question, subject=subject)
        for image, subject in zip(images, subjects, strict=True)
    ]
    return await ask_all(asks, calls)


async def choose_views(
    question: Question,
    groups: Sequence[Sequence[str | None]],
    caller: Caller,
    calls: list[CallRow],
) -> list[Choice]:
    """Return one choice per cluster, from the candidates' answer texts alone.

    Nothing is asked where one candidate is left or all answers are the same text: the first then stands, which is the
    initial view. A candidate without an answer takes no part; a cluster without any has no choice.

    Args:
        question: The query.
        groups: For each cluster its candidates' answers, the initial view first.
        caller: Sends the calls.
        calls: Where the rows are appended.
    """
    answered = [[position for position, text in enumerate(group) if text is not None] for group in groups]
    texts = [[text for text in group if text is not None] for group in groups]
    open_groups = [number for number, group in enumerate(texts) if len(set(group)) > 1]
    asks = [
        caller.ask(
            "choice",
            {"question": question.question, "candidates": texts[number]},
            (),
            partial(parse_index, count=len(texts[number])),
            question=question,
            subject=f"cluster {number}",
        )
        for number in open_groups
    ]
    indices = await ask_all(asks, calls)
    replies = dict(zip(open_groups, indices, strict=True))
    choices = []
    for number, positions in enumerate(answered):
        index = replies.get(number, 0)
        if not positions:
            choices.append(Choice(None, f"no view of cluster {number} got an answer"))
        elif index is None:
            choices.append(Choice(None, f"the choice for cluster {number} could not be read"))
        else:
            choices.append(Choice(positions[index]))
    return choices
