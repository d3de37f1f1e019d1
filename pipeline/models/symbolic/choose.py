"""Choosing among answers by their words alone, as the text-only judge of views does."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from pipeline.models.symbolic.certainty import Certainty, certainty_of
from pipeline.models.symbolic.content import content_of


def choose(question: str, candidates: Sequence[str]) -> int:
    """Return the index of the answer that serves a question best.

    A definite answer goes before a hedged one, that before one which sees nothing, that before one which cannot tell.
    Among equals the one most candidates agree on wins, then the one that says most beyond the question, then the first.

    Args:
        question: What was asked.
        candidates: Answers, at least one.
    """
    levels = [certainty_of(text) for text in candidates]
    best = max(levels)
    if best == Certainty.UNKNOWN:
        return 0
    said = [_said(question, text) for text in candidates]
    votes = Counter(said[i] for i in range(len(candidates)) if levels[i] == best)
    return max(
        (i for i in range(len(candidates)) if levels[i] == best),
        key=lambda i: (votes[said[i]], len(said[i]), -i),
    )


def verify(question: str, candidates: Sequence[str]) -> int:
    """Return which of two answers to keep: the one that answers; when both or neither do, the first.

    Args:
        question: What was asked.
        candidates: The answer of the initial view, then that of the final view.
    """
    levels = [certainty_of(text) for text in candidates]
    return max(range(len(candidates)), key=lambda i: (levels[i], -i))


def _said(question: str, text: str) -> frozenset[object]:
    """What an answer says beyond the words of the question."""
    asked, answer = content_of(question), content_of(text)
    polarity = {answer.polarity} - {None}
    return frozenset((answer.words - asked.words) | answer.numbers | (answer.relations - asked.relations) | polarity)
