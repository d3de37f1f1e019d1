"""Answering from several views at once: which view to trust, and which views show what is described."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.models.symbolic.answer_view import Answer, answer_view
from pipeline.models.symbolic.certainty import Certainty
from pipeline.models.symbolic.perceive import View
from pipeline.models.symbolic.phrases import Query
from pipeline.models.symbolic.resolve import candidates, prominence, resolve

FITS = 0.55
"""Fit from which a view's main thing is taken for one that is described: all that can be judged holds, with at most
one doubt (small, or a colour that light may have changed)."""


def answer_one(query: Query, views: Sequence[View]) -> tuple[int, str]:
    """Return the view to trust and its answer.

    Args:
        query: The question or description, read.
        views: At least one view.
    """
    answers = [answer_view(query, view) for view in views]
    best = _best(query, answers)
    return best, answers[best].text


def answer_many(query: Query, views: Sequence[View]) -> list[bool]:
    """Return for each view whether the most prominent thing of the described name fits the description."""
    return [_main_thing_fits(query, view) for view in views]


def _best(query: Query, answers: Sequence[Answer]) -> int:
    indices = range(len(answers))
    if query.kind == "count":
        # Views overlap, so counts are not added; a view hides things but does not invent them, so the largest stands.
        return max(indices, key=lambda i: (answers[i].count or 0, answers[i].certainty, answers[i].support, -i))
    if query.kind in ("describe", "which"):
        measured = [a.measure for a in answers if a.measure is not None]
        if measured:
            return min(indices, key=lambda i: _by_measure(answers[i], i))
        return max(indices, key=lambda i: (answers[i].certainty, answers[i].support, -i))
    if query.kind == "exists":
        return max(indices, key=lambda i: (answers[i].certainty, answers[i].support, -i))
    level = max(answer.certainty for answer in answers)
    weight: dict[str, float] = {}
    for answer in answers:
        if answer.certainty == level:
            weight[answer.content] = weight.get(answer.content, 0.0) + answer.support
    return max(
        (i for i in indices if answers[i].certainty == level),
        key=lambda i: (round(weight[answers[i].content], 6), answers[i].support, -i),
    )


def _by_measure(answer: Answer, index: int) -> tuple[bool, float, float, int]:
    """Each view singles out its own nearest or largest; over all views the first of these is meant."""
    seen = answer.certainty >= Certainty.HEDGED and answer.measure is not None
    return not seen, answer.measure if answer.measure is not None else 0.0, -answer.support, index


def _main_thing_fits(query: Query, view: View) -> bool:
    named = candidates(query.target, view)
    if not named or query.target.anything:
        return False
    main = max(named, key=lambda i: (prominence(view.things[i]), -i))
    return any(match.index == main and match.fit >= FITS for match in resolve(query.target, view))
