"""Judging views: the model answers from each candidate alone, then one is chosen per cluster (paper 3.3).

The paper chooses by the answers' texts alone; its ablation (tab. "VLM-as-Judge design") shows the judge the views
instead of the texts, or both. Verification compares texts in every design, as the paper's does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from pipeline.models.caller import Caller
from pipeline.models.messages import ImagePart
from pipeline.models.replies import parse_index, parse_text
from pipeline.query.ask_all import ask_all
from pipeline.query.savings import EQUAL_ANSWERS, EQUAL_PICTURES, Savings
from schemas.calls import CallRow
from schemas.questions import Question

Design = Literal["text", "image", "image_text", "all_views"]

WITHOUT_ANSWERS = ("image", "all_views")
"""Designs in which views are not answered one by one."""


class JudgeConfig(BaseModel):
    """Which judgements are made, and which calls are spared (paper 3.3 and 4.4)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    design: Design = Field(
        default="text",
        description="What the choice among a cluster's views is made from. text: their answers (paper). image: the "
        "views themselves, which then are not answered one by one. image_text: both. all_views: nothing is chosen, and "
        "the model answers from every candidate at once (paper, supplement, number of views); with many targets, where "
        "each view stands for one instance, the initial views stay.",
    )
    verify: bool = Field(default=True, description="Compare the answers of initial and final views (paper 3.3).")
    mark: bool = Field(default=True, description="Ask the judge for LLM-Match marks where a reference answer is known.")
    exact_savings: bool = Field(
        default=True, description="Make no call whose outcome is known (docs/decisions/0002); false asks everything."
    )
    stop_when_definite: bool = Field(
        default=False,
        description="Lossy: where the initial view's answer is definite, do not ask the cluster's novel views. "
        "Reads English answers.",
    )
    skip_redundant_views: bool = Field(
        default=False, description="Lossy: do not ask a novel view that shows no Gaussian of the cluster anew."
    )
    redundant_share: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="Share of the cluster's Gaussians up to which a view that shows them anew counts as redundant.",
    )

    @model_validator(mode="after")
    def _policies_fit_the_design(self) -> JudgeConfig:
        if self.stop_when_definite and self.design in WITHOUT_ANSWERS:
            raise ValueError(f"stop_when_definite needs the answers of views, which {self.design} does not ask for")
        return self


@dataclass(frozen=True, slots=True)
class Shown:
    """One candidate view as the choice sees it."""

    image: ImagePart
    """Its picture; candidates that show the same one hold the same object."""
    text: str | None
    """The answer from it alone; None where it was not asked or came out blank."""


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
    groups: Mapping[int, Sequence[Shown | None]],
    caller: Caller,
    calls: list[CallRow],
    *,
    design: Design = "text",
    savings: Savings | None,
) -> dict[int, Choice]:
    """Return one choice per cluster.

    Where there is nothing to choose between, the first candidate stands, which is the initial view: when all answers
    are the same text (design text) or all candidates show the same picture (the others). A cluster without any
    candidate that takes part has no choice.

    Args:
        question: The query.
        groups: Candidates by cluster number, the initial view first; None for one that takes no part. Neither does
            one without an answer, but for design image.
        caller: Sends the calls.
        calls: Where the rows are appended.
        design: What the choice is made from.
        savings: Counts the choices not asked for; None to ask for all.
    """
    asked: dict[int, dict[int, Shown]] = {}
    choices: dict[int, Choice] = {}
    for number, group in groups.items():
        part = _taking_part(group, design)
        different = part if savings is None else _different(part, design)
        if not part:
            choices[number] = Choice(None, f"no view of cluster {number} got an answer")
        elif savings is not None and len(different) == 1:
            savings.add("choice", EQUAL_ANSWERS if design == "text" else EQUAL_PICTURES)
            choices[number] = Choice(next(iter(different)))
        else:
            # Equal answers stay in a choice by text: how many views agree is worth knowing.
            asked[number] = part if design == "text" else different
    asks = []
    for number, part in asked.items():
        variables, images = _form(question, list(part.values()), design)
        parse = partial(parse_index, count=len(part))
        asks.append(caller.ask("choice", variables, images, parse, question=question, subject=f"cluster {number}"))
    indices = await ask_all(asks, calls)
    for (number, part), index in zip(asked.items(), indices, strict=True):
        unread = f"the choice for cluster {number} could not be read"
        choices[number] = Choice(None, unread) if index is None else Choice(list(part)[index])
    return {number: choices[number] for number in groups}


def is_definite(text: str) -> bool:
    """Return whether an answer states something without a doubt. Of other languages than English nothing is known."""
    from pipeline.models.symbolic.certainty import Certainty, certainty_of  # only where the policy asks for it

    letters = [character for character in text if character.isalpha()]
    english = 2 * sum(map(str.isascii, letters)) > len(letters)
    return english and certainty_of(text) == Certainty.DEFINITE


def _taking_part(group: Sequence[Shown | None], design: Design) -> dict[int, Shown]:
    """Return the candidates to choose from, by position."""
    return {
        position: shown
        for position, shown in enumerate(group)
        if shown is not None and (design == "image" or shown.text is not None)
    }


def _different(part: Mapping[int, Shown], design: Design) -> dict[int, Shown]:
    """Return the first of those that read the same, or in the other designs show the same picture."""
    first: dict[object, int] = {}
    for position, shown in part.items():
        first.setdefault(shown.text if design == "text" else id(shown.image), position)
    return {position: part[position] for position in first.values()}


def _form(question: Question, shown: Sequence[Shown], design: Design) -> tuple[dict[str, Any], tuple[ImagePart, ...]]:
    variables: dict[str, Any] = {"question": question.question}
    if design != "image":
        variables["candidates"] = [candidate.text for candidate in shown]
    if design == "text":
        return variables, ()
    return variables | {"design": design}, tuple(candidate.image for candidate in shown)
