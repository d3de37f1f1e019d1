"""LLM-Match, the score of open answers: a judge's mark of 1 to 5 mapped to 0 to 100 (OpenEQA protocol).

Who marked, and how its reply is read, is not known here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

MARK_MIN, MARK_MAX = 1, 5
"""The judge's scale: wrong to the same meaning."""

MISSING_MARK = 0
"""Mark of a question that was answered with nothing, as the protocol has it; it scores 0 like a mark of 1."""


@dataclass(frozen=True, slots=True)
class LlmMatch:
    """A mean score with what it was taken over."""

    mean: float | None
    """Mean over the scored questions, 0 to 100; None when none is scored."""
    scored: int
    """Questions with a mark."""
    unscored: int
    """Questions without one: they are in no mean, and never silently 0."""


def cut_prediction(prediction: str) -> str:
    """Return what the judge is shown: the prediction up to its last full stop.

    A text that breaks off in the middle of a sentence loses that sentence; one without any full stop stays whole.
    """
    end = prediction.rfind(".")
    return prediction[: end + 1] if end >= 0 else prediction


def needs_judge(prediction: str | None) -> bool:
    """Return whether there is an answer to be marked; where not, the mark is `MISSING_MARK` and no call is made."""
    return prediction is not None and bool(prediction.strip())


def match_score(mark: int) -> float:
    """Return the score of one mark, 100 * (clip(mark, 1, 5) - 1) / 4, from 0 to 100."""
    return 100.0 * (min(max(mark, MARK_MIN), MARK_MAX) - MARK_MIN) / (MARK_MAX - MARK_MIN)


def llm_match(marks: Sequence[int | None]) -> LlmMatch:
    """Return the mean score of questions.

    Args:
        marks: One a question; None where it is unscored (no readable mark, no reference, a failed call).
    """
    scores = [match_score(mark) for mark in marks if mark is not None]
    mean = sum(scores) / len(scores) if scores else None
    return LlmMatch(mean, len(scores), len(marks) - len(scores))
