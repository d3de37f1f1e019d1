"""Evidence categories: which objects of the scene help to answer, as a language model says (C_evidence, paper 3.1)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from pydantic import BaseModel, ConfigDict, Field

from pipeline.models.caller import Caller, rows_of
from pipeline.models.replies import parse_evidence
from schemas.answers import Status
from schemas.calls import CallRow
from schemas.errors import QuestionError
from schemas.questions import Question


class EvidenceConfig(BaseModel):
    """How many categories are kept (paper, supplement A.2)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    k_eqa: int = Field(default=3, ge=1, description="Categories for a question to be answered in words.")
    k_grounding: int = Field(default=1, ge=1, description="Categories for grounding, single and multi-target.")

    def k(self, question: Question) -> int:
        """Return how many categories this question gets."""
        return self.k_eqa if question.task == "eqa" else self.k_grounding


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the evidence stage found for a question."""

    status: Status
    """answered: there are categories; skipped: none is useful; unparsed or failed: nothing could be read."""
    reason: str
    """Why there are no categories; empty when there are."""
    categories: tuple[str, ...]
    """Evidence categories, most useful first."""
    calls: tuple[CallRow, ...]
    """Calls made."""
    seconds: float
    """Wall seconds."""


async def find_evidence(
    question: Question, vocabulary: Sequence[str], caller: Caller, config: EvidenceConfig
) -> Evidence:
    """Return the categories that the model picks from those present in the scene.

    Nothing is asked of a scene without categories: there is nothing to choose from.

    Args:
        question: The query.
        vocabulary: Names present in the scene, as `SceneContext.vocabulary` gives them.
        caller: Sends the call.
        config: How many names are kept.

    Raises:
        RetryError: The endpoint failed for a reason that may pass.
        StopError: No call can succeed.
    """
    start = time.perf_counter()
    if not vocabulary:
        return Evidence("failed", "the scene has no categories: splatreasoner label adds them", (), (), 0.0)
    names, k = sorted(vocabulary), config.k(question)
    try:
        asked = await caller.ask(
            "evidence",
            {"question": question.question, "categories": names, "k": k},
            (),
            partial(parse_evidence, vocabulary=names, k=k),
            question=question,
        )
    except QuestionError as error:
        reason = f"evidence: {type(error).__name__}: {error}"
        return Evidence("failed", reason, (), rows_of(error), time.perf_counter() - start)
    seconds = time.perf_counter() - start
    if asked.value is None:
        return Evidence("unparsed", "evidence: the reply names no category of the scene", (), asked.rows, seconds)
    if not asked.value:
        return Evidence("skipped", "no category of the scene is evidence for the question", (), asked.rows, seconds)
    return Evidence("answered", "", asked.value, asked.rows, seconds)
